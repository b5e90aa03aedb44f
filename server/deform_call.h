#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/codec/block.h"
#include "server/call.h"
#include "server/design_failures.h"
#include "server/memory.h"
#include "server/scheduler.h"
#include "server/system_cache.h"

namespace deform::server {

/// What a deformation call needs of the engine; all outlive it.
struct DeformParts {
  Scheduler* scheduler;
  SystemCache* cache;
  MemoryBudget* memory;
  CallRegistry* calls;
  std::size_t block_points;
  std::function<void(std::size_t designs)> on_served;
};

/// What distinguishes one deformation from another.
struct DeformTask {
  std::string system_id;
  std::uint64_t request_id = 0;
  std::size_t designs = 1;
  v1::Output output;
  SystemCache::Prepare prepare;  ///< of the system, should it not be resident
  /// Bytes that `bind` and its result need.
  std::function<std::size_t(const ResidentSystem&)> bind_bytes;
  std::function<BoundDesigns(const ResidentSystem&, const RunContext&)> bind;
  Failures failures = Failures::fail_request;
  /// Who looks at whole designs; may be empty, and may give nobody.
  std::function<std::unique_ptr<const DesignChecker>(const SystemCache::Handle&, const RunContext&)> checker;
};

/// How the designs of a call are cut: step s covers block s % blocks of the designs of group s / blocks. Blocks of the designs of
/// one step leave one after the other, so designs interleave and each one's blocks ascend. Where somebody looks at whole designs,
/// another step comes before the blocks of a group: it makes all points of its designs.
struct StepPlan {
  static constexpr std::size_t group_designs = 16;  ///< share one pass over the basis
  static constexpr std::size_t whole_bytes = std::size_t{256} << 20;

  std::size_t points = 0, block_points = 0, designs = 0;
  bool whole = false;

  std::size_t group() const {
    const std::size_t fit = whole ? std::max<std::size_t>(1, whole_bytes / (points * sizeof(Vec3))) : group_designs;
    return std::min({designs, group_designs, fit});
  }
  std::size_t blocks() const { return (points + block_points - 1) / block_points; }
  std::size_t groups() const { return designs == 0 ? 0 : (designs + group() - 1) / group(); }
  std::size_t group_steps() const { return blocks() + (whole ? 1 : 0); }
  std::size_t steps() const { return group_steps() * groups(); }
  bool is_whole(std::size_t step) const { return whole && step % group_steps() == 0; }
  std::size_t first_step(std::size_t step) const { return step / group_steps() * group_steps(); }  ///< of the group of a step
  std::size_t first_design(std::size_t step) const { return step / group_steps() * group(); }
  std::size_t design_count(std::size_t step) const { return std::min(group(), designs - first_design(step)); }
  std::size_t block(std::size_t step) const { return step % group_steps() - (whole ? 1 : 0); }
  std::size_t first_point(std::size_t step) const { return block(step) * block_points; }
  std::size_t point_count(std::size_t step) const { return std::min(block_points, points - first_point(step)); }
  std::size_t step_bytes() const { return group() * std::min(block_points, points) * sizeof(Vec3); }
};

/// One deformation: waits for its system, is bound on a worker, then runs in steps that evaluate and encode one block of up to 16
/// designs each. At most workers / running-requests steps of a call run at once. Finished replies wait in a buffer; at its high
/// water mark the call gives up its slot and no worker is held until the reader has drained it to the low one.
class DeformCall : public Call {
 public:
  DeformCall(const DeformParts& parts, DeformTask task, CallContext context, std::function<void()> on_ready);

  /// Enters queue and registry and asks for the system; throws when refused.
  void begin();

  DeformJob::Poll poll(v1::DeformReply& reply);
  void fail(const Error& error) override;
  std::optional<Error> error() const;
  CallStats stats() const;

 private:
  /// What the running steps share; lives until the last of them is over.
  struct Bound : BoundDesigns {
    SystemCache::Handle system;
    Failures failures = Failures::fail_request;
    std::unique_ptr<const DesignChecker> checker;  ///< null: nobody looks at whole designs
    StepPlan plan;                                 ///< of the designs that could be bound
    codec::EncodeOptions output;
    Charge charge;
  };
  /// All points of the designs of a group, and what was found about them.
  struct WholeDesigns {
    std::vector<Points> points;
    std::vector<DesignChecker::Findings> findings;
    DesignErrors failed;  ///< by their place in the group: they have no blocks
  };
  /// Outcome of one step: per design its block.
  struct StepResult {
    std::shared_ptr<WholeDesigns> whole;  ///< of the step that makes them
    std::vector<codec::Block> blocks;
    std::size_t bytes = 0;
    double solve_ms = 0, encode_ms = 0;
  };
  /// Of a design of the group under way.
  struct Progress {
    std::vector<std::uint64_t> checksums;
    double max_error = 0;
    std::uint32_t fell_back = 0;
  };
  class Notice;

  std::shared_ptr<DeformCall> self() { return std::static_pointer_cast<DeformCall>(shared_from_this()); }
  void on_system(SystemCache::Handle system, const std::optional<Error>& error);
  void enqueue(SystemCache::Handle system);
  void start(Scheduler::Slot slot);
  std::shared_ptr<Bound> bind(const SystemCache::Handle& system, int threads);
  void run_step(const std::shared_ptr<const Bound>& bound, std::size_t step, const std::shared_ptr<const WholeDesigns>& whole);
  StepResult make_whole(const Bound& bound, std::size_t step) const;
  StepResult make_step(const Bound& bound, std::size_t step, const WholeDesigns* whole) const;

  // With mutex_ held:
  void schedule_steps();
  bool may_begin(std::size_t step) const;
  bool room() const;
  void release_step(std::size_t step, StepResult&& result);
  void push_header();
  void push_results(std::size_t step);
  void push_failure(std::size_t number, const Error& error);
  void push_summary();
  v1::DeformReply& push();
  void end();

  const DeformParts parts_;
  DeformTask task_;
  const std::function<void()> on_ready_;
  const RunContext::Clock::time_point accepted_ = RunContext::Clock::now();

  mutable std::mutex mutex_;
  // guarded by mutex_
  Scheduler::Place place_;
  Scheduler::Slot slot_;
  SystemCache::Ticket ticket_;
  SystemCache::Handle system_;
  std::shared_ptr<Bound> bound_;
  std::size_t next_step_ = 0;     // to be scheduled
  std::size_t next_release_ = 0;  // steps leave in order
  std::size_t in_flight_ = 0;
  std::map<std::size_t, StepResult> finished_;
  std::size_t buffered_bytes_ = 0;  // of finished_ and replies_
  std::deque<v1::DeformReply> replies_;
  std::vector<Progress> progress_;
  std::shared_ptr<WholeDesigns> whole_;  // of the group under way
  bool reader_waits_ = false;
  bool produced_ = false;  // the summary is in replies_
  bool ended_ = false;     // nothing more comes
  std::optional<Error> error_;
  CallStats stats_;
  double bind_ms_ = 0;
  bool prepared_again_ = false;
  std::uint32_t fell_back_ = 0;
  std::size_t failed_ = 0;  // designs, of those that were bound
};

/// What the client holds: letting go of it cancels.
std::shared_ptr<DeformJob> make_deform_job(std::shared_ptr<DeformCall> call);

}  // namespace deform::server
