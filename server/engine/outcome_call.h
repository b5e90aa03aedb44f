// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "core/base/control_group.h"
#include "server/engine/call.h"
#include "server/engine/memory.h"
#include "server/engine/scheduler.h"
#include "server/engine/system_cache.h"

namespace deform::server {

/// A request with one answer: waits for its system, if it needs one, then computes on a worker, or what takes long on a thread
/// for preparations. on_done is called exactly once, from such a thread or the registry's, without a lock.
template <typename T>
class OutcomeCall : public Call {
 public:
  struct Parts {
    Scheduler* scheduler;
    SystemCache* cache;
    CallRegistry* calls;
  };
  struct Task {
    std::string system_id;  ///< empty: none is needed, and compute() gets none
    SystemCache::Source source;
    bool brings_setup =
        false;  ///< source.prepare() does not read it from the store, so that one which is gone is no reason to fail
    std::function<void(const std::string& stage, double fraction)> on_progress;  ///< may be empty
    std::function<T(const SystemCache::Handle&, const RunContext&)> compute;
    /// The cost of compute() on a worker, for Scheduler::start(); empty: as little as possible.
    std::function<double(const ResidentSystem&)> cost;
    /// About how long compute() takes. Set, it is work for the threads of preparations, never for a worker.
    std::optional<double> seconds;
    std::function<void(Engine::Outcome<T>)> on_done;
  };

  OutcomeCall(const Parts& parts, Task task, CallContext context)
      : Call(std::move(context)), parts_(parts), task_(std::move(task)) {
    stats_.system_id = task_.system_id;
  }

  /// Throws when refused; on_done is not called then.
  void begin() {
    if (const auto error = overdue(accepted_)) throw *error;
    const bool resident = task_.system_id.empty() || parts_.cache->would_find(key(), task_.source);
    place_ = parts_.scheduler->enter(context().client,
                                     resident && !task_.seconds ? Scheduler::Queue::workers : Scheduler::Queue::preparations);
    parts_.calls->add(shared_from_this());
    if (context().open) context().open->set_subject("", task_.system_id);
    if (!task_.system_id.empty()) enter(v1::CALL_PREPARING);
    if (task_.system_id.empty()) return enqueue({});
    try {
      ask();
    } catch (...) {
      parts_.calls->remove(this);
      throw;
    }
  }

  void fail(const Error& error) override {
    stop();
    end({std::nullopt, error, {}});
  }

 private:
  std::shared_ptr<OutcomeCall> self() { return std::static_pointer_cast<OutcomeCall>(shared_from_this()); }

  std::string key() const { return key_of({context().tenant, task_.system_id}); }

  void ask() {
    SystemCache::Asker asker;
    asker.client = context().client;
    asker.tenant = context().tenant;
    asker.most_preparations = context().quota.preparations;
    asker.on_progress = task_.on_progress;
    asker.on_done = [call = self()](SystemCache::Handle system, const std::optional<Error>& error) {
      call->on_system(std::move(system), error);
    };
    auto [system, ticket] = parts_.cache->acquire(key(), task_.source, std::move(asker));
    if (system) return enqueue(std::move(system));
    const std::lock_guard lock(mutex_);
    if (!ended_) ticket_ = std::move(ticket);  // otherwise it leaves here
  }

  void ask_again() {
    try {
      ask();
    } catch (const Error& error) {
      fail(error);
    }
  }

  void on_system(SystemCache::Handle system, const std::optional<Error>& error) {
    if (error && error->code() == ErrorCode::not_found && task_.brings_setup && !std::exchange(asked_again_, true)) {
      return ask_again();  // the preparation of somebody else, who named a stored setup that was deleted
    }
    if (error) return fail(*error);
    {
      const std::lock_guard lock(mutex_);
      stats_.prepare_ms = elapsed_ms(accepted_);
    }
    enqueue(std::move(system));
  }

  void enqueue(SystemCache::Handle system) {
    const std::lock_guard lock(mutex_);
    if (ended_) return;
    const double cost = task_.seconds          ? *task_.seconds * Scheduler::points_per_second
                        : system && task_.cost ? task_.cost(*system)
                                               : static_cast<double>(Scheduler::least_cost);
    enter(v1::CALL_WAITING);
    if (context().open) {
      context().open->set_cost(cost);
      if (system) context().open->set_subject(system->info.geometry_id(), "");
    }
    if (task_.seconds) {
      const auto prepare = [call = self(), system = std::move(system)] { call->run(system, {}); };
      return parts_.scheduler->prepare(context().client, this, *task_.seconds, prepare);
    }
    parts_.scheduler->start(context().client, this, cost, [call = self(), system = std::move(system)](Scheduler::Slot slot) {
      call->run(system, std::move(slot));
    });
  }

  /// How many threads fall to each of those who compute now.
  int share() const {
    const Scheduler::Load load = parts_.scheduler->load();
    const std::size_t sharing = std::max<std::size_t>(1, task_.seconds ? load.preparations : load.running);
    return std::max(1, (task_.seconds ? available_cores() : parts_.scheduler->workers()) / static_cast<int>(sharing));
  }

  void run(const SystemCache::Handle& system, Scheduler::Slot slot) {
    {
      const std::lock_guard lock(mutex_);
      if (ended_) return;
      place_.leave();
      stats_.queue_ms = elapsed_ms(accepted_);
      enter(v1::CALL_RUNNING);
      if (system) {
        stats_.geometry_id = system->info.geometry_id();
        stats_.points = system->info.points();
      }
    }
    const auto from = RunContext::Clock::now();
    Engine::Outcome<T> outcome;
    try {
      outcome.value = task_.compute(system, run_context(share()));
    } catch (const Error& error) {
      outcome.error = error;
    } catch (const std::bad_alloc&) {
      outcome.error = Error(ErrorCode::out_of_budget, "the machine is out of memory; lower the server's memory budget")
                          .refused_for(Refusal::memory);
    } catch (const std::exception& error) {
      outcome.error = Error(ErrorCode::internal, error.what());
    }
    {
      const std::lock_guard lock(mutex_);
      stats_.solve_ms = elapsed_ms(from);
    }
    slot.leave();
    end(std::move(outcome));
  }

  void end(Engine::Outcome<T> outcome) {
    {
      const std::lock_guard lock(mutex_);
      if (ended_) return;
      ended_ = true;
      if (outcome.error) outcome.error = reason(*outcome.error);
      outcome.stats = stats_;
      place_.leave();
      ticket_.leave();
    }
    const auto keep_alive = self();
    parts_.scheduler->remove(this);
    task_.on_done(std::move(outcome));
    parts_.calls->remove(this);  // last: a drained engine has called back
  }

  const Parts parts_;
  const Task task_;
  const RunContext::Clock::time_point accepted_ = RunContext::Clock::now();
  bool asked_again_ = false;  // of the answers to asking, which come one after the other
  std::mutex mutex_;
  // guarded by mutex_
  Scheduler::Place place_;
  SystemCache::Ticket ticket_;
  bool ended_ = false;
  CallStats stats_;
};

}  // namespace deform::server
