// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <string>

#include "server/engine/call.h"
#include "server/engine/scheduler.h"
#include "server/engine/system_cache.h"

namespace deform::server {

/// What calls need of the engine to come to work; all outlive them.
struct QueueParts {
  Scheduler* scheduler;
  SystemCache* cache;
  CallRegistry* calls;
};

/// A call that waits for its system and for a slot, is then started on a worker, and whose replies wait for their reader. A class
/// that derives from it says what is done with the slot. Instantiated for the replies of deformations and of evaluations.
template <typename Reply>
class QueuedCall : public Call {
 public:
  /// Enters queue and registry and asks for the system; throws when refused.
  void begin();

  DeformJob::Poll poll(Reply& reply);
  void fail(const Error& error) override;
  std::optional<Error> error() const;
  CallStats stats() const;

 protected:
  /// Calls `on_ready` after the lock is released, once per pending answer.
  class Notice {
   public:
    explicit Notice(QueuedCall& call) : call_(call) {}
    ~Notice() {
      if (due_ && call_.on_ready_) call_.on_ready_();
    }
    Notice(const Notice&) = delete;
    Notice& operator=(const Notice&) = delete;
    /// With the lock held.
    void check() {
      if (!call_.reader_waits_ || (call_.replies_.empty() && !call_.ended_)) return;
      call_.reader_waits_ = false;
      due_ = true;
    }

   private:
    QueuedCall& call_;
    bool due_ = false;
  };

  /// `source`: of the system, should it not be resident. `designs`: for the statistics.
  QueuedCall(const QueueParts& parts, const std::string& system_id, SystemCache::Source source, std::size_t designs,
             CallContext context, std::function<void()> on_ready);

  /// Does the work; what goes wrong ends the call. False when it did.
  template <typename Work>
  bool attempt(const Work& work) {
    try {
      work();
      return true;
    } catch (const Error& error) {
      fail(error);
    } catch (const std::bad_alloc&) {
      fail(Error(ErrorCode::out_of_budget, "the machine is out of memory; lower the server's memory budget")
               .refused_for(Refusal::memory));
    } catch (const std::exception& error) {
      fail(Error(ErrorCode::internal, error.what()));
    }
    return false;
  }

  /// On a worker, with the slot, without the lock.
  virtual void start(const SystemCache::Handle& system) = 0;

  // With mutex_ held:
  /// A reply is about to leave.
  virtual void on_taken(const Reply& reply) = 0;
  /// Lets go of what the call holds. Running steps keep what they need and find out when they are done.
  virtual void drop() = 0;
  void end();

  /// How many of the workers fall to one of the running calls, at least one.
  std::size_t share() const;

  const RunContext::Clock::time_point accepted_ = RunContext::Clock::now();

  mutable std::mutex mutex_;
  // guarded by mutex_
  Scheduler::Slot slot_;
  std::deque<Reply> replies_;
  bool produced_ = false;  // the last reply is in replies_
  bool ended_ = false;     // nothing more comes
  bool prepared_again_ = false;
  CallStats stats_;

 private:
  std::string key() const { return key_of({context().tenant, stats_.system_id}); }
  void ask();
  void on_system(SystemCache::Handle system, const std::optional<Error>& error);
  void enqueue(SystemCache::Handle system);
  void take(Scheduler::Slot slot);
  std::shared_ptr<QueuedCall> self() { return std::static_pointer_cast<QueuedCall>(shared_from_this()); }

  const QueueParts queue_;
  const SystemCache::Source source_;
  const std::function<void()> on_ready_;

  // guarded by mutex_
  Scheduler::Place place_;
  SystemCache::Ticket ticket_;
  SystemCache::Handle system_;
  bool reader_waits_ = false;
  std::optional<Error> error_;
};

}  // namespace deform::server
