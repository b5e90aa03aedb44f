// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "core/codec/block.h"
#include "core/quality/extreme.h"
#include "server/engine/design_failures.h"
#include "server/engine/design_result.h"
#include "server/engine/memory.h"
#include "server/engine/queued_call.h"
#include "server/engine/scheduler.h"
#include "server/engine/step_plan.h"
#include "server/engine/system_cache.h"

namespace deform::server {

/// What a deformation call needs of the engine; all outlive it.
struct DeformParts : QueueParts {
  MemoryBudget* memory;
  std::size_t block_points;
  std::function<void(std::size_t designs)> on_served;
};

/// What distinguishes one deformation from another.
struct DeformTask {
  /// What is sent per point: where it is, or a vector that is no place (a derivative): then nothing is said about displacements.
  enum class Values { positions, vectors };

  std::string system_id;
  std::uint64_t request_id = 0;
  std::size_t designs = 1;
  v1::Output output;
  Values values = Values::positions;
  SystemCache::Source source;  ///< of the system, should it not be resident
  /// Bytes that `bind` and its result need.
  std::function<std::size_t(const ResidentSystem&)> bind_bytes;
  std::function<BoundDesigns(const ResidentSystem&, const RunContext&)> bind;
  Failures failures = Failures::fail_request;
  /// Makes the checks of whole designs; may be empty, and may give none.
  std::function<std::unique_ptr<const DesignChecker>(const SystemCache::Handle&, const RunContext&)> checker;
};

/// One deformation: waits for its system, is bound on a worker, then runs in steps that evaluate and encode one block of up to 16
/// designs each. At most workers / running-requests steps of a call run at once. Finished replies wait in a buffer; at its high
/// water mark the call gives up its slot and no worker is held until the reader has drained it to the low one.
class DeformCall : public QueuedCall<v1::DeformReply> {
 public:
  DeformCall(const DeformParts& parts, DeformTask task, CallContext context, std::function<void()> on_ready);

 private:
  /// What the running steps share; lives until the last of them is over.
  struct Bound : BoundDesigns {
    SystemCache::Handle system;
    Failures failures = Failures::fail_request;
    std::unique_ptr<const DesignChecker> checker;  ///< null: whole designs are not checked
    StepPlan plan;                                 ///< of the designs that could be bound
    codec::EncodeOptions output;
    DeformTask::Values values = DeformTask::Values::positions;
    Charge charge;
    mutable std::mutex spare_mutex;
    mutable std::vector<std::unique_ptr<Vec3[]>> spare;  ///< guarded by spare_mutex; arrays of groups that are done
  };
  /// All points of the designs of a group, and what was found about them.
  struct WholeDesigns {
    explicit WholeDesigns(std::size_t blocks) : missing(blocks) {}
    void gather(const Bound& bound, std::size_t designs);
    Vec3* design(std::size_t d) { return gathered.empty() ? points[d].data() : gathered[d].get(); }

    std::vector<Points> points;
    std::vector<DesignChecker::Findings> findings;
    // Where they are gathered: written to by whoever makes a block, read by whoever made the last.
    std::once_flag allocated;
    std::vector<std::unique_ptr<Vec3[]>> gathered;
    std::atomic<std::size_t> missing;  ///< blocks
    DesignErrors failed;               ///< by their place in the group: they have no blocks
  };
  /// Outcome of one step: per design its block.
  struct StepResult {
    std::shared_ptr<WholeDesigns> whole;  ///< of the step that makes them
    std::vector<codec::Block> blocks;
    std::vector<Extreme> displacements;            ///< the largest of the block
    std::vector<PlaneSides::Crossings> crossings;  ///< in the block
    std::size_t bytes = 0;
    double solve_ms = 0, encode_ms = 0;
  };

  std::shared_ptr<DeformCall> self() { return std::static_pointer_cast<DeformCall>(shared_from_this()); }
  void start(const SystemCache::Handle& system) override;
  std::shared_ptr<Bound> bind(const SystemCache::Handle& system, int threads);
  void charge(Bound& bound, std::size_t binding) const;
  void run_step(const std::shared_ptr<const Bound>& bound, std::size_t step, const std::shared_ptr<WholeDesigns>& whole);
  StepResult make_whole(const Bound& bound, std::size_t step) const;
  StepResult make_step(const Bound& bound, std::size_t step, WholeDesigns* whole) const;
  void look(const Bound& bound, std::size_t designs, WholeDesigns& whole) const;

  // With mutex_ held:
  void on_taken(const v1::DeformReply& reply) override;
  void drop() override;
  void schedule_steps();
  bool may_begin(std::size_t step) const;
  bool room() const;
  void release_step(std::size_t step, StepResult&& result);
  void push_header();
  void push_results(std::size_t step, WholeDesigns* whole);
  void push_failure(std::size_t number, const Error& error);
  void push_summary();
  v1::DeformReply& push();

  const DeformParts parts_;
  DeformTask task_;

  // guarded by mutex_
  std::shared_ptr<Bound> bound_;
  std::size_t next_step_ = 0;     // to be scheduled
  std::size_t next_release_ = 0;  // steps leave in order
  std::size_t in_flight_ = 0;
  std::map<std::size_t, StepResult> finished_;
  std::size_t buffered_bytes_ = 0;                              // of finished_ and replies_
  std::vector<DeliveredDesign> progress_;                       // of the designs of the group under way
  std::map<std::size_t, std::shared_ptr<WholeDesigns>> whole_;  // of the groups under way, by their first steps
  double bind_ms_ = 0;
  std::uint32_t fell_back_ = 0;
  std::size_t failed_ = 0;  // designs, of those that were bound
};

}  // namespace deform::server
