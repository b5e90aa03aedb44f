// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/evaluate_call.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/mesh/coordinate_limits.h"
#include "core/quality/displacement.h"
#include "proto/convert/base/block.h"
#include "proto/convert/base/fields.h"
#include "proto/convert/report.h"

namespace deform::server {

namespace {

std::string block_field(std::size_t number, const char* field) {
  return "blocks[" + std::to_string(number) + "]" + (field[0] == '\0' ? "" : ".") + field;
}

/// The checks of a block that need none of its bytes.
void check_block(const v1::Block& block, std::size_t number, std::uint64_t first) {
  const auto refuse = [&](const char* field, const std::string& what) {
    convert::refuse_field(block_field(number, field), what);
  };
  if (block.design() != 0) refuse("design", std::to_string(block.design()) + ", there is one design, 0");
  if (block.block() != number) {
    refuse("block", std::to_string(block.block()) + ", blocks come in order, " + std::to_string(number) + " is next");
  }
  if (block.first() != first) {
    refuse("first", std::to_string(block.first()) + ", but " + std::to_string(first) + " points came before");
  }
  if (block.count() == 0 || block.count() > EvaluateCall::most_points) {
    refuse("count", std::to_string(block.count()) + " is out of range 1.." + std::to_string(EvaluateCall::most_points));
  }
  const bool wide = block.encoding() == v1::RAW_F64;
  if (!wide && block.encoding() != v1::RAW_F32)
    refuse("encoding", "must be RAW_F64 or RAW_F32, there is nothing to be relative to");
  const std::size_t bytes = block.count() * (wide ? sizeof(Vec3) : 3 * sizeof(float));
  if (block.data().size() != bytes) {
    refuse("data", std::to_string(block.data().size()) + " bytes, " + std::to_string(block.count()) + " points take " +
                       std::to_string(bytes));
  }
}

std::vector<Vec3> decoded(v1::Block& message, std::size_t number, std::uint64_t first) {
  std::vector<Vec3> points(message.count());
  try {
    codec::decode(convert::block_from_proto(std::move(message)), points, points);
  } catch (const Error& error) {
    throw Error(error.code(), block_field(number, "") + ": " + error.what());
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!is_finite(points[i])) convert::refuse_field("points[" + std::to_string(first + i) + "]", "must be finite");
  }
  check_magnitudes(points, "points", first);
  return points;
}

}  // namespace

EvaluateCall::EvaluateCall(EvaluateParts parts, EvaluateTask task, CallContext context, std::function<void()> on_ready)
    : QueuedCall(parts, task.system_id, task.source, 1, std::move(context), std::move(on_ready)),
      parts_(std::move(parts)),
      task_(std::move(task)) {}

/// Enough for all workers while as many answers are under way to the reader.
std::size_t EvaluateCall::window() const { return 2 * static_cast<std::size_t>(parts_.scheduler->workers()) + 2; }

void EvaluateCall::start(const SystemCache::Handle& system) {
  const auto from = RunContext::Clock::now();
  std::shared_ptr<Bound> bound;
  if (!attempt([&] { bound = bind(system, static_cast<int>(share())); })) return;
  Notice notice(*this);
  const std::lock_guard lock(mutex_);
  if (ended_) return;
  bind_ms_ = elapsed_ms(from);
  stats_.solve_ms += bind_ms_;
  stats_.geometry_id = bound->system->info.geometry_id();
  bound_ = std::move(bound);
  task_.bind = nullptr;  // owns the request
  task_.bind_bytes = nullptr;
  task_.doubts = nullptr;
  note_bytes();
  push_info();
  push_result_when_done();
  slot_.leave();  // until there is a block
  notice.check();
}

std::shared_ptr<EvaluateCall::Bound> EvaluateCall::bind(const SystemCache::Handle& system, int threads) {
  auto bound = std::make_shared<Bound>();
  bound->system = system;
  bound->box = bounding_box(system->mesh->points);
  bound->output = convert::encode_options(task_.output, system->info.diagonal());
  const System::SpaceBytes space = system->system->space_bytes(most_points);
  // Bytes of a block: as it came, decoded, moved, encoded (integers and bytes), and what evaluating takes.
  bound->block_bytes = 5 * most_points * sizeof(Vec3) + space.call;
  const std::size_t binding = task_.bind_bytes(*system) + space.map;
  bound->charge = parts_.memory->charge_call(binding + bound->block_bytes, purpose(system->charge.bytes()), context().share());
  bound->map = task_.bind(*system, run_context(threads));
  bound->doubts = task_.doubts(*system);
  if (const auto beyond = beyond_digits(bound->map->report().prescribed_displacement, system->info.diagonal())) {
    throw Error(ErrorCode::invalid_argument, "design: " + *beyond);
  }
  return bound;
}

ChargePurpose EvaluateCall::purpose(std::size_t held) const {
  return {"evaluating system " + task_.system_id.substr(0, 16) + " at other points", "raise the server's memory budget", held};
}

bool EvaluateCall::has_room() {
  std::shared_ptr<Bound> bound;
  {
    const std::lock_guard lock(mutex_);
    if (!accepts()) return false;
    if (added_ - taken_ <= bound_->more_blocks.size()) return true;
    bound = bound_;
  }
  // Without the lock: systems may be evicted for it.
  Charge another;
  try {
    another = parts_.memory->charge_call(bound->block_bytes, purpose(bound->system->charge.bytes() + bound->charge.bytes()),
                                         context().share());
  } catch (const Error&) {
    return false;  // there is again when an answer was taken
  }
  const std::lock_guard lock(mutex_);
  if (!accepts()) return false;
  bound->more_blocks.push_back(std::move(another));
  note_bytes();
  return true;
}

void EvaluateCall::add(v1::Block&& block) {
  const std::lock_guard lock(mutex_);
  if (ended_) return;
  if (no_more_ || bound_ == nullptr) throw Error(ErrorCode::internal, "a block came before it was asked for");
  check_block(block, added_, points_);
  const std::uint64_t first = points_;
  points_ += block.count();
  ++added_;
  waiting_.emplace_back(first, std::move(block));
  schedule();
  note_turn();
}

void EvaluateCall::finish() {
  Notice notice(*this);
  const std::lock_guard lock(mutex_);
  if (ended_ || no_more_) return;
  no_more_ = true;
  push_result_when_done();
  notice.check();
}

// Many requests use one worker each, a lone one all.
void EvaluateCall::schedule() {
  if (waiting_.empty() || bound_ == nullptr) return;
  if (!slot_.held()) slot_ = parts_.scheduler->resume();
  const std::size_t most = share();
  while (!waiting_.empty() && in_flight_ < most) {
    ++in_flight_;
    auto [first, block] = std::move(waiting_.front());
    waiting_.pop_front();
    parts_.scheduler->step(
        this, [call = self(), bound = bound_, number = begun_, first = first,
               message = std::make_shared<v1::Block>(std::move(block))] { call->run_step(bound, number, first, *message); });
    ++begun_;
  }
}

void EvaluateCall::run_step(const std::shared_ptr<const Bound>& bound, std::size_t number, std::uint64_t first,
                            v1::Block& message) {
  StepResult result;
  if (!attempt([&] { result = make_step(*bound, number, first, message); })) return;
  Notice notice(*this);
  const std::lock_guard lock(mutex_);
  if (ended_) return;
  --in_flight_;
  stats_.solve_ms += result.solve_ms;
  stats_.encode_ms += result.encode_ms;
  finished_.emplace(number, std::move(result));
  for (auto next = finished_.begin(); next != finished_.end() && next->first == released_; next = finished_.begin()) {
    StepResult ready = std::move(next->second);
    finished_.erase(next);
    release(released_++, std::move(ready));
  }
  schedule();
  if (in_flight_ == 0) slot_.leave();  // until the next block
  push_result_when_done();
  note_turn();
  notice.check();
}

EvaluateCall::StepResult EvaluateCall::make_step(const Bound& bound, std::size_t number, std::uint64_t first,
                                                 v1::Block& message) const {
  const RunContext context = run_context(1);
  const double begun = thread_cpu_ms();
  const std::vector<Vec3> points = decoded(message, number, first);
  const double read = thread_cpu_ms();
  StepResult result;
  result.first = first;
  std::vector<Vec3> moved(points.size());
  result.told = bound.map->evaluate(points, first, moved, context);
  context.check();
  const double evaluated = thread_cpu_ms();
  const Extreme largest = largest_displacement(moved, points);
  result.displacement = {largest.value, largest.id + static_cast<std::size_t>(first)};
  result.place = points[largest.id];
  result.block = codec::encode(points, moved, bound.output);
  result.solve_ms = evaluated - read;
  result.encode_ms = read - begun + thread_cpu_ms() - evaluated;
  return result;
}

void EvaluateCall::release(std::size_t number, StepResult&& result) {
  checksum_.add(result.block.checksum);
  sums_.set_max_error(std::max(sums_.max_error(), result.block.max_error));
  sums_.set_blocks_fell_back(sums_.blocks_fell_back() + (result.block.fell_back ? 1 : 0));
  if (result.displacement.value > displacement_.value) {
    displacement_ = result.displacement;
    place_ = result.place;
  }
  sums_.set_still(sums_.still() + result.told.still);
  sums_.set_sums_error(std::max(sums_.sums_error(), result.told.sums_error));
  stats_.bytes += result.block.bytes.size();
  stats_.points += result.block.count;
  v1::Block& message = *replies_.emplace_back().mutable_block();
  message.set_block(static_cast<std::uint32_t>(number));
  message.set_first(result.first);
  convert::block_to_proto(std::move(result.block), message);
}

void EvaluateCall::note_turn() {
  const bool ours = bound_ == nullptr || in_flight_ > 0;
  waits_since_ = ours ? RunContext::Clock::time_point::max() : RunContext::Clock::now();
}

void EvaluateCall::note_bytes() const {
  if (!context().open) return;
  context().open->set_result_bytes(bound_->charge.bytes() + bound_->more_blocks.size() * bound_->block_bytes);
}

void EvaluateCall::push_info() {
  v1::EvaluateInfo& info = *replies_.emplace_back().mutable_info();
  info.set_geometry_id(bound_->system->info.geometry_id());
  info.set_diagonal(bound_->system->info.diagonal());
  info.set_most_points(most_points);
  note_turn();
}

void EvaluateCall::push_result_when_done() {
  if (!no_more_ || produced_ || bound_ == nullptr || released_ < added_) return;
  v1::EvaluateResult& result = *replies_.emplace_back().mutable_result();
  result = std::move(sums_);
  const DesignReport& report = bound_->map->report();
  result.set_points(points_);
  result.set_max_displacement(displacement_.value);
  result.set_checksum(checksum_.value());
  result.set_interpolation_residual(report.interpolation_residual);
  result.set_estimated_error(report.error);
  result.set_reduction_error(bound_->system->info.reduction_error() * report.prescribed_displacement);
  result.set_converged(report.converged || report.at_rounding);
  for (const std::string& doubt : bound_->doubts) result.add_doubts(doubt);
  for (const std::string& warning : report.warnings) result.add_warnings(warning);
  const std::string given_up = convert::given_up_warning(report, bound_->system->setup);
  if (!given_up.empty()) result.add_warnings(given_up);
  if (report.at_rounding) result.add_warnings(convert::rounding_note(report.convergence_error));
  if (const auto warning = displacement_warning_elsewhere(displacement_, place_, report.prescribed_displacement, bound_->box)) {
    result.add_warnings(*warning);
  }
  result.set_queue_ms(stats_.queue_ms);
  result.set_bind_ms(bind_ms_);
  result.set_solve_ms(stats_.solve_ms - bind_ms_);
  result.set_encode_ms(stats_.encode_ms);
  result.set_wall_ms(elapsed_ms(accepted_));
  produced_ = true;
  parts_.on_served();
}

void EvaluateCall::on_taken(const v1::EvaluateReply& reply) {
  note_turn();
  if (!reply.has_block()) return;
  if (++taken_ < added_ || bound_ == nullptr || bound_->more_blocks.empty()) return;
  bound_->more_blocks.clear();  // all are answered: the next one may be long in coming
  note_bytes();
}

std::optional<Error> EvaluateCall::overdue(RunContext::Clock::time_point now) const {
  if (auto error = Call::overdue(now)) return error;
  const RunContext::Clock::time_point since = waits_since_;
  if (since == RunContext::Clock::time_point::max() || now < since || now - since < patience) return std::nullopt;
  return Error(ErrorCode::deadline_exceeded,
               "the client has neither sent nor taken a block for " + std::to_string(patience.count()) + " seconds");
}

void EvaluateCall::drop() {
  finished_.clear();
  waiting_.clear();
  bound_.reset();
}

namespace {

class EvaluateHandle : public EvaluateJob {
 public:
  explicit EvaluateHandle(std::shared_ptr<EvaluateCall> call) : call_(std::move(call)) {}
  ~EvaluateHandle() override { cancel(); }
  EvaluateHandle(const EvaluateHandle&) = delete;
  EvaluateHandle& operator=(const EvaluateHandle&) = delete;

  bool has_room() override { return call_->has_room(); }
  void add(v1::Block&& block) override { call_->add(std::move(block)); }
  void finish() override { call_->finish(); }
  DeformJob::Poll poll(v1::EvaluateReply& reply) override { return call_->poll(reply); }
  void cancel() override { call_->fail(Error(ErrorCode::cancelled, "cancelled by the caller")); }
  std::optional<Error> error() const override { return call_->error(); }
  CallStats stats() const override { return call_->stats(); }

 private:
  const std::shared_ptr<EvaluateCall> call_;
};

}  // namespace

std::shared_ptr<EvaluateJob> make_evaluate_job(std::shared_ptr<EvaluateCall> call) {
  return std::make_shared<EvaluateHandle>(std::move(call));
}

}  // namespace deform::server
