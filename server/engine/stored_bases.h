// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <stop_token>
#include <thread>

#include "core/base/run_context.h"
#include "server/engine/engine.h"
#include "server/engine/memory.h"
#include "server/engine/system_cache.h"
#include "server/store/store.h"

namespace deform::server {

/// The handle bases of prepared systems in the store, so that whoever has to serve a design of a system that is not in memory can
/// do so at once, with the same bits: after a restart, after an eviction, or in place of another server that had it. What cannot
/// be written or read is logged, and prepared as if there were none. Thread-safe.
class StoredBases {
 public:
  /// Both outlive this.
  StoredBases(Store& store, MemoryBudget& memory);
  /// What has not been written yet is left out.
  ~StoredBases();

  /// Has the basis of a system written, if it has one that can be stored, on a thread of its own.
  void keep(const OwnedId& id, const std::shared_ptr<const ResidentSystem>& system, const Quota& quota);

  /// A system of Extent::basis; null when there is none to restore. `resident` has mesh, setup and description, and gets
  /// system and charge. Throws Error(out_of_budget) and the errors of the context.
  std::shared_ptr<ResidentSystem> restore(const OwnedId& id, std::shared_ptr<ResidentSystem> resident, const RunContext& context);
  bool contains(const OwnedId& id) const { return store_.bases().wanted() && store_.bases().contains(id); }

  Engine::StoredBasisCounts counts() const;

  /// True when everything is written before the time is over.
  bool wait_until_written(RunContext::Clock::time_point limit);

 private:
  struct Task {
    OwnedId id;
    std::shared_ptr<const ResidentSystem> system;
    Quota quota;
  };
  void run(const std::stop_token& stop);
  void write(const Task& task, const std::stop_token& stop);

  Store& store_;
  MemoryBudget& memory_;
  std::atomic<std::uint64_t> restored_{0}, refused_{0}, written_{0}, not_written_{0};
  std::mutex mutex_;
  // under mutex_
  std::condition_variable_any changed_;
  std::deque<Task> tasks_;
  bool writing_ = false;
  std::jthread writer_;  // last: it uses the others
};

}  // namespace deform::server
