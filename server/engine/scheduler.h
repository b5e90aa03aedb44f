// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "server/engine/fair_queue.h"

namespace deform::server {

/// Who computes when. Three kinds of work:
///
///   start        the first piece of a request; waits in a bounded place, see below; begins only while fewer than
///                `running_limit` requests are running, so that requests are finished rather than all begun
///   step         a further, short piece of a running request; first come, first served, so running requests share the workers
///   preparation  a system, and whatever else is no matter of milliseconds; has threads of its own, so that it never keeps a
///                step waiting; one of them takes only short preparations, so that these never wait for long ones
///
/// Starts, short preparations and long ones are each taken in the order of a FairQueue.
///
/// One worker pool serves starts and steps, steps and starts in turn. Work must not throw. No lock is held while it runs.
/// Thread-safe.
class Scheduler {
 public:
  struct Options {
    int workers = 1;
    int preparation_workers = 1;  ///< beside the one for short preparations
    std::size_t queue_limit = 256;
    std::size_t running_limit = 4;
  };
  using Work = std::function<void()>;
  static constexpr std::size_t least_cost = 1000;
  /// What a worker computes of a design that needs no solution, encoded: what a second of anything else costs.
  static constexpr double points_per_second = 1e7;
  static constexpr double short_seconds = 2;     ///< of a preparation
  static constexpr double least_seconds = 0.02;  ///< what one counts at least

  /// What a request waits for: each has as many places of its own, so that what is prepared leaves room for what is there.
  enum class Queue { workers, preparations };

  /// A request that waits: counted against queue_limit and its client until left or destroyed. Movable.
  class Place {
   public:
    Place() = default;
    Place(Place&& other) noexcept : scheduler_(other.scheduler_), queue_(other.queue_), client_(std::move(other.client_)) {
      other.scheduler_ = nullptr;
    }
    Place& operator=(Place&& other) noexcept;
    ~Place() { leave(); }
    void leave();

   private:
    friend class Scheduler;
    Place(Scheduler* scheduler, Queue queue, std::string client)
        : scheduler_(scheduler), queue_(queue), client_(std::move(client)) {}
    Scheduler* scheduler_ = nullptr;
    Queue queue_ = Queue::workers;
    std::string client_;
  };

  /// A request that runs. Held while it has work for the workers, not while it waits for its reader. Movable.
  class Slot {
   public:
    Slot() = default;
    Slot(Slot&& other) noexcept : scheduler_(other.scheduler_) { other.scheduler_ = nullptr; }
    Slot& operator=(Slot&& other) noexcept;
    ~Slot() { leave(); }
    void leave();
    bool held() const { return scheduler_ != nullptr; }

   private:
    friend class Scheduler;
    explicit Slot(Scheduler* scheduler) : scheduler_(scheduler) {}
    Scheduler* scheduler_ = nullptr;
  };

  explicit Scheduler(const Options& options);
  ~Scheduler();

  /// Throws Error(out_of_budget) with a retry hint when queue_limit requests wait there already, or when this client has more
  /// than four times as many places as are free (dynamic thresholds: Choudhury and Hahne 1998). So n clients that take all they
  /// get have 4 / (4 n + 1) of the places each, and there is room for the next one.
  Place enter(const std::string& client, Queue queue = Queue::workers);

  /// `owner` is what remove() names; any address that is unique while the work waits. `cost`: how many points
  /// are computed, and `least_cost` for what a request or design takes beside them.
  void start(const std::string& client, const void* owner, double cost, std::function<void(Slot)> work);
  void step(const void* owner, Work work);
  /// `seconds`: about how long it takes.
  void prepare(const std::string& client, const void* owner, double seconds, Work work);

  /// A slot for a request that goes on after waiting for its reader: it need not queue again.
  Slot resume();

  /// Forgets what waits of that owner; what runs already goes on.
  void remove(const void* owner);

  /// Runs what is queued, then ends the threads. Idempotent; work that comes later never runs.
  void stop();

  struct Load {
    std::size_t waiting = 0;                  ///< places taken of Queue::workers
    std::size_t waiting_for_preparation = 0;  ///< and of Queue::preparations
    std::size_t running = 0;                  ///< slots taken
    std::size_t preparations = 0;             ///< running now
  };
  Load load() const;
  /// The limit for requests that come later.
  void set_queue_limit(std::size_t requests);
  std::size_t queue_limit() const;
  int workers() const { return options_.workers; }

 private:
  struct Piece {
    const void* owner;
    Work work;
  };
  void run_worker();
  void run_preparations(bool only_short);
  bool take_start(std::function<void(Slot)>& work);
  bool take_step(Work& work);
  std::size_t& waiting_in(Queue queue) { return queue == Queue::workers ? load_.waiting : load_.waiting_for_preparation; }
  void leave_place(Queue queue, const std::string& client);
  void leave_slot();

  const Options options_;
  mutable std::mutex mutex_;
  // guarded by mutex_
  std::size_t queue_limit_;
  std::condition_variable work_available_;
  std::condition_variable preparation_available_;
  FairQueue<std::function<void(Slot)>> starts_;
  FairQueue<Work> preparations_;  // long ones
  FairQueue<Work> short_preparations_;
  std::map<std::pair<Queue, std::string>, std::size_t> places_;  // taken, of those who have any
  std::deque<Piece> steps_;
  Load load_;
  bool step_next_ = true;
  bool stopping_ = false;
  // set by the constructor
  std::vector<std::thread> threads_;
};

}  // namespace deform::server
