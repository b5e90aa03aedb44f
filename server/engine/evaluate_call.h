// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/codec/block.h"
#include "core/deformers/space_map.h"
#include "core/quality/extreme.h"
#include "server/engine/memory.h"
#include "server/engine/queued_call.h"
#include "server/engine/scheduler.h"
#include "server/engine/system_cache.h"

namespace deform::server {

/// What evaluating at other points needs of the engine; all outlive it.
struct EvaluateParts : QueueParts {
  MemoryBudget* memory;
  std::function<void()> on_served;
};

/// What is evaluated.
struct EvaluateTask {
  std::string system_id;
  v1::Output output;
  SystemCache::Source source;  ///< of the system, should it not be resident
  /// Bytes that binding the design needs.
  std::function<std::size_t(const ResidentSystem&)> bind_bytes;
  std::function<std::unique_ptr<const SpaceMap>(const ResidentSystem&, const RunContext&)> bind;
  std::function<std::vector<std::string>(const ResidentSystem&)> doubts;  ///< design_doubts() of the design
};

/// One design at points as they come: waits for its system, is bound on a worker, then decodes, evaluates and encodes one block
/// per step. Blocks are answered in the order in which they came. At most `window()` blocks are held at once, from add() until
/// their answer has been taken. The memory of one is charged as long as the call lasts, that of more while they are there, so
/// that calls that wait for their clients hold little.
///
/// A call that waits for its client, which neither sends a block nor takes one for `patience`, ends.
class EvaluateCall : public QueuedCall<v1::EvaluateReply> {
 public:
  static constexpr std::size_t most_points = 40'000;  ///< of a block, so that a raw one stays below 1 MiB
  static constexpr std::chrono::seconds patience{60};

  EvaluateCall(EvaluateParts parts, EvaluateTask task, CallContext context, std::function<void()> on_ready);

  bool has_room();
  void add(v1::Block&& block);
  void finish();
  std::optional<Error> overdue(RunContext::Clock::time_point now) const override;

 private:
  /// What the running steps share; lives until the last of them is over.
  struct Bound {
    SystemCache::Handle system;
    std::unique_ptr<const SpaceMap> map;
    std::vector<std::string> doubts;
    codec::EncodeOptions output;
    Box box;  ///< of the mesh at rest
    std::size_t block_bytes = 0;
    Charge charge;                    ///< of the binding and of one block
    std::vector<Charge> more_blocks;  ///< of blocks beyond that one; guarded by mutex_
  };
  struct StepResult {
    codec::Block block;
    std::uint64_t first = 0;
    Extreme displacement;
    Vec3 place{};  ///< of the point that moves most, at rest
    SpaceMap::Found told;
    double solve_ms = 0, encode_ms = 0;
  };

  std::shared_ptr<EvaluateCall> self() { return std::static_pointer_cast<EvaluateCall>(shared_from_this()); }
  std::size_t window() const;
  ChargePurpose purpose(std::size_t held) const;
  void start(const SystemCache::Handle& system) override;
  std::shared_ptr<Bound> bind(const SystemCache::Handle& system, int threads);
  void run_step(const std::shared_ptr<const Bound>& bound, std::size_t number, std::uint64_t first, v1::Block& message);
  StepResult make_step(const Bound& bound, std::size_t number, std::uint64_t first, v1::Block& message) const;

  // With mutex_ held:
  bool accepts() const { return bound_ != nullptr && !ended_ && !no_more_ && added_ - taken_ < window(); }
  void on_taken(const v1::EvaluateReply& reply) override;
  void drop() override;
  void schedule();
  void release(std::size_t number, StepResult&& result);
  void note_turn();
  void note_bytes() const;
  void push_info();
  void push_result_when_done();

  const EvaluateParts parts_;
  EvaluateTask task_;

  /// Since when it waits for the client; the end of time: it does not. Read by the registry, whose lock comes before ours.
  std::atomic<RunContext::Clock::time_point> waits_since_{RunContext::Clock::time_point::max()};

  // guarded by mutex_
  std::shared_ptr<Bound> bound_;
  std::deque<std::pair<std::uint64_t, v1::Block>> waiting_;  // number of the first point, and the block
  std::size_t added_ = 0;                                    // blocks
  std::size_t begun_ = 0;
  std::size_t released_ = 0;
  std::size_t taken_ = 0;
  std::size_t in_flight_ = 0;
  std::uint64_t points_ = 0;
  std::map<std::size_t, StepResult> finished_;
  bool no_more_ = false;  // blocks
  double bind_ms_ = 0;
  codec::ChecksumFold checksum_;
  v1::EvaluateResult sums_;  // what is gathered over the blocks
  Extreme displacement_;     // the largest, and where that point is at rest
  Vec3 place_{};
};

/// What the client holds: letting go of it cancels.
std::shared_ptr<EvaluateJob> make_evaluate_job(std::shared_ptr<EvaluateCall> call);

}  // namespace deform::server
