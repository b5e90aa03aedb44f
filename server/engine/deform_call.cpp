// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/deform_call.h"

#include <algorithm>
#include <array>
#include <utility>

#include "core/base/parallel.h"
#include "core/quality/displacement.h"
#include "proto/convert/base/block.h"
#include "proto/convert/verdict.h"

namespace deform::server {

namespace {

// Points evaluated between two looks at the stop token.
constexpr std::size_t slice_points = 4096;

}  // namespace

DeformCall::DeformCall(const DeformParts& parts, DeformTask task, CallContext context, std::function<void()> on_ready)
    : QueuedCall(parts, task.system_id, task.source, task.designs, std::move(context), std::move(on_ready)),
      parts_(parts),
      task_(std::move(task)) {}

void DeformCall::start(const SystemCache::Handle& system) {
  const auto from = RunContext::Clock::now();
  std::shared_ptr<Bound> bound;
  if (!attempt([&] { bound = bind(system, static_cast<int>(share())); })) return;
  Notice notice(*this);
  const std::lock_guard lock(mutex_);
  if (ended_) return;
  bind_ms_ = elapsed_ms(from);
  stats_.solve_ms += bind_ms_;
  stats_.geometry_id = bound->system->info.geometry_id();
  stats_.points = bound->plan.points;
  bound_ = std::move(bound);
  task_.bind = nullptr;  // owns the request
  task_.bind_bytes = nullptr;
  task_.checker = nullptr;
  push_header();
  for (const auto& [number, failure] : bound_->failed) push_failure(number, failure);
  bound_->plan.designs == 0 ? push_summary() : schedule_steps();
  notice.check();
}

std::shared_ptr<DeformCall::Bound> DeformCall::bind(const SystemCache::Handle& system, int threads) {
  auto bound = std::make_shared<Bound>();
  bound->system = system;
  if (task_.checker) bound->checker = task_.checker(system, run_context(threads));
  bound->plan = {system->mesh->point_count(), parts_.block_points, task_.designs};
  if (bound->checker) {
    bound->plan.looks = bound->checker->only_faces() ? StepPlan::Looks::after_blocks : StepPlan::Looks::before_blocks;
  }
  if (!bound->plan.whole()) bound->plan.spread(threads);  // whole designs are made by all workers together
  bound->output = convert::encode_options(task_.output, system->info.diagonal());
  const std::size_t solving = std::min(task_.designs, static_cast<std::size_t>(threads)) * system->system->info().design_bytes;
  bound->values = task_.values;
  charge(*bound, task_.bind_bytes(*system) + solving);
  if (context().open) context().open->set_result_bytes(bound->charge.bytes());
  static_cast<BoundDesigns&>(*bound) = task_.bind(*system, run_context(threads));
  bound->plan.designs = bound->numbers.size();
  bound->failures = task_.failures;
  bound->charge.shrink(bound->charge.bytes() - solving);  // only what is bound stays, however slow the reader is
  if (context().open) context().open->set_result_bytes(bound->charge.bytes());
  return bound;
}

// Where designs are gathered and memory is short, fewer of them share a pass.
void DeformCall::charge(Bound& bound, std::size_t binding) const {
  const int workers = parts_.scheduler->workers();
  const ChargePurpose purpose{"deforming with system " + task_.system_id.substr(0, 16), "send fewer designs per request",
                              bound.system->charge.bytes()};
  for (;;) {
    const StepPlan& plan = bound.plan;
    const std::size_t looking = plan.gathers() ? plan.open_groups(workers) * bound.checker->check_faces_bytes() : 0;
    try {
      bound.charge = parts_.memory->charge_call(binding + looking + plan.buffer_bytes(workers), purpose, context().share());
      return;
    } catch (const Error& error) {
      if (error.code() != ErrorCode::out_of_budget || !plan.gathers() || plan.group() == 1) throw;
      bound.plan.most_designs = plan.group() / 2;
    }
  }
}

void DeformCall::run_step(const std::shared_ptr<const Bound>& bound, std::size_t step,
                          const std::shared_ptr<WholeDesigns>& whole) {
  StepResult result;
  const auto make = [&] {
    result = bound->plan.is_whole(step) ? make_whole(*bound, step) : make_step(*bound, step, whole.get());
  };
  if (!attempt(make)) return;
  Notice notice(*this);
  const std::lock_guard lock(mutex_);
  if (ended_) return;
  --in_flight_;
  buffered_bytes_ += result.bytes;
  stats_.solve_ms += result.solve_ms;
  stats_.encode_ms += result.encode_ms;
  finished_.emplace(step, std::move(result));
  for (auto next = finished_.begin(); next != finished_.end() && next->first == next_release_; next = finished_.begin()) {
    StepResult ready = std::move(next->second);
    finished_.erase(next);
    release_step(next_release_++, std::move(ready));
  }
  if (next_release_ == bound_->plan.steps()) {
    push_summary();
  } else {
    schedule_steps();
  }
  notice.check();
}

// In the memory of a group that is done, where there is one: fresh memory costs as much as the look at it.
void DeformCall::WholeDesigns::gather(const Bound& bound, std::size_t designs) {
  const std::lock_guard lock(bound.spare_mutex);
  gathered.clear();
  for (std::size_t d = 0; d < designs; ++d) {
    const bool none = bound.spare.empty();
    gathered.push_back(none ? std::make_unique_for_overwrite<Vec3[]>(bound.plan.points) : std::move(bound.spare.back()));
    if (!none) bound.spare.pop_back();
  }
}

// Alone in its call, so on all threads that fall to it.
DeformCall::StepResult DeformCall::make_whole(const Bound& bound, std::size_t step) const {
  const RunContext context = run_context(static_cast<int>(share()));
  const auto begun = RunContext::Clock::now();
  StepResult result;
  result.whole = std::make_shared<WholeDesigns>(0);
  const std::size_t first = bound.plan.first_design(step), count = bound.plan.design_count(step);
  result.whole->points.assign(count, Points(bound.plan.points));
  parallel_for(context, bound.plan.points, slice_points, [&](std::size_t begin, std::size_t end) {
    std::vector<Vec3*> out(count);
    for (std::size_t d = 0; d < count; ++d) out[d] = result.whole->points[d].data() + begin;
    bound.evaluation->evaluate(begin, end, first, out);
  });
  for (std::size_t d = 0; d < count; ++d) {
    auto& findings = result.whole->findings.emplace_back();
    try {
      findings = bound.checker->check(bound.numbers[first + d], bound.evaluation->field_motion(first + d),
                                      result.whole->points[d], context);
    } catch (const Error& error) {
      if (bound.failures == Failures::fail_request || !fails_alone(error)) throw;
      result.whole->failed.emplace(d, error);
    }
  }
  result.solve_ms = elapsed_ms(begun);
  return result;
}

DeformCall::StepResult DeformCall::make_step(const Bound& bound, std::size_t step, WholeDesigns* whole) const {
  const RunContext context = run_context(1);
  const std::size_t designs = bound.plan.design_count(step);
  const std::size_t first = bound.plan.first_point(step), count = bound.plan.point_count(step);
  const double begun = thread_cpu_ms();
  std::unique_ptr<Vec3[]> made;
  std::vector<Vec3*> deformed(designs);
  if (whole == nullptr) made = std::make_unique_for_overwrite<Vec3[]>(designs * count);
  if (bound.plan.gathers()) std::call_once(whole->allocated, [&] { whole->gather(bound, designs); });
  for (std::size_t d = 0; d < designs; ++d) deformed[d] = made ? made.get() + d * count : whole->design(d) + first;
  if (!bound.plan.whole()) {
    std::vector<Vec3*> out(designs);
    for (std::size_t begin = 0; begin < count; begin += slice_points) {
      context.check();
      for (std::size_t d = 0; d < designs; ++d) out[d] = deformed[d] + begin;
      const std::size_t end = std::min(count, begin + slice_points);
      bound.evaluation->evaluate(first + begin, first + end, bound.plan.first_design(step), out);
    }
  }
  const double evaluated = thread_cpu_ms();
  StepResult result;
  const std::span<const Vec3> registered(bound.system->mesh->points.data() + first, count);
  for (std::size_t d = 0; d < designs; ++d) {
    context.check();
    codec::Block& block = result.blocks.emplace_back();
    Extreme& displacement = result.displacements.emplace_back();
    PlaneSides::Crossings& crossings = result.crossings.emplace_back();
    if (whole != nullptr && whole->failed.contains(d)) continue;
    const std::span<const Vec3> points(deformed[d], count);
    if (bound.values == DeformTask::Values::positions) {
      const Extreme largest = largest_displacement(points, registered);
      displacement = {largest.value, largest.id + first};
      crossings = bound.system->sides.crossings(points, first);
    }
    block = codec::encode(registered, points, bound.output);
    result.bytes += block.bytes.size();
  }
  const double encoded = thread_cpu_ms();
  if (bound.plan.gathers() && whole->missing.fetch_sub(1) == 1) look(bound, designs, *whole);
  result.solve_ms = evaluated - begun + thread_cpu_ms() - encoded;
  result.encode_ms = encoded - evaluated;
  return result;
}

// A lone group is waited for, so it is looked at on all threads that fall to it; otherwise those make the next one.
void DeformCall::look(const Bound& bound, std::size_t designs, WholeDesigns& whole) const {
  const RunContext context = run_context(bound.plan.groups() > 1 ? 1 : static_cast<int>(share()));
  whole.findings.resize(designs);
  for (std::size_t d = 0; d < designs; ++d) {
    whole.findings[d].faces = bound.checker->check_faces({whole.design(d), bound.plan.points}, context);
  }
  const std::lock_guard lock(bound.spare_mutex);
  for (auto& points : whole.gathered) bound.spare.push_back(std::move(points));
}

bool DeformCall::room() const {
  const std::size_t busy = buffered_bytes_ + in_flight_ * bound_->plan.step_bytes();
  return busy == 0 || busy + bound_->plan.step_bytes() <= bound_->plan.high_water(parts_.scheduler->workers());
}

// The blocks of a group need its whole designs, and these the memory of those before.
bool DeformCall::may_begin(std::size_t step) const {
  const StepPlan& plan = bound_->plan;
  if (plan.gathers()) return step != plan.first_step(step) || whole_.size() < plan.open_groups(parts_.scheduler->workers());
  return !plan.whole() || next_release_ > plan.first_step(step) || next_release_ == step;
}

// Many requests use one worker each, a lone one all.
void DeformCall::schedule_steps() {
  const std::size_t steps = bound_->plan.steps();
  if (!slot_.held()) {
    if (next_step_ == steps || !room()) return;
    slot_ = parts_.scheduler->resume();
  }
  const std::size_t most = share();
  while (next_step_ < steps && in_flight_ < most && may_begin(next_step_) && room()) {
    ++in_flight_;
    const std::size_t first = bound_->plan.first_step(next_step_);
    if (bound_->plan.gathers() && next_step_ == first) whole_[first] = std::make_shared<WholeDesigns>(bound_->plan.blocks());
    const auto found = whole_.find(first);
    parts_.scheduler->step(
        this, [call = self(), bound = bound_, step = next_step_, whole = found == whole_.end() ? nullptr : found->second] {
          call->run_step(bound, step, whole);
        });
    ++next_step_;
  }
  if (in_flight_ == 0) slot_.leave();  // the reader is behind
}

v1::DeformReply& DeformCall::push() {
  v1::DeformReply& reply = replies_.emplace_back();
  reply.set_request_id(task_.request_id);
  return reply;
}

void DeformCall::push_header() {
  v1::DeformHeader& header = *push().mutable_header();
  header.set_points(bound_->plan.points);
  header.set_designs(static_cast<std::uint32_t>(task_.designs));
  header.set_block_points(static_cast<std::uint32_t>(bound_->plan.block_points));
  header.set_geometry_id(bound_->system->info.geometry_id());
}

void DeformCall::release_step(std::size_t step, StepResult&& result) {
  const StepPlan& plan = bound_->plan;
  if (plan.is_whole(step)) {
    whole_[step] = std::move(result.whole);
    return;
  }
  const std::size_t block = plan.block(step);
  if (block == 0) progress_.assign(plan.design_count(step), {});
  const auto whole = whole_.find(plan.first_step(step));
  for (std::size_t d = 0; d < result.blocks.size(); ++d) {
    if (whole != whole_.end() && whole->second->failed.contains(d)) continue;
    codec::Block& encoded = result.blocks[d];
    progress_[d].add(encoded, result.displacements[d], result.crossings[d]);
    stats_.bytes += encoded.bytes.size();
    v1::Block& message = *push().mutable_block();
    message.set_design(static_cast<std::uint32_t>(bound_->numbers[plan.first_design(step) + d]));
    message.set_block(static_cast<std::uint32_t>(block));
    message.set_first(plan.first_point(step));
    convert::block_to_proto(std::move(encoded), message);
  }
  if (block + 1 < plan.blocks()) return;
  push_results(step, whole == whole_.end() ? nullptr : whole->second.get());
  if (whole != whole_.end()) whole_.erase(whole);
}

void DeformCall::push_results(std::size_t step, WholeDesigns* whole) {
  for (std::size_t d = 0; d < progress_.size(); ++d) {
    const std::size_t design = bound_->plan.first_design(step) + d;
    if (whole != nullptr && whole->failed.contains(d)) {
      push_failure(bound_->numbers[design], whole->failed.at(d));
      ++failed_;
      continue;
    }
    v1::DesignResult& result = *push().mutable_result();
    const DesignReport& report = bound_->evaluation->report(design);
    const auto& info = bound_->system->info;
    result = design_result(progress_[d], report, bound_->system->setup, info);
    result.set_design(static_cast<std::uint32_t>(bound_->numbers[design]));
    if (whole != nullptr) whole->findings[d].move_to(result);
    if (bound_->values == DeformTask::Values::positions) {
      result.set_points_across_symmetry(progress_[d].crossings.points);
      convert::set_verdict(
          {bound_->system->size().judged_by, info.condition(), report.converged, report.torn_edges, report.misfit,
           convert::method_facts(info.setup()), bound_->doubts.empty() ? std::vector<std::string>() : bound_->doubts[design]},
          result);
    }
    fell_back_ += progress_[d].fell_back;
  }
}

void DeformCall::push_failure(std::size_t number, const Error& error) {
  v1::DesignResult& result = *push().mutable_result();
  result.set_design(static_cast<std::uint32_t>(number));
  *result.mutable_error() = failure_to_proto(error);
}

void DeformCall::push_summary() {
  v1::DeformSummary& summary = *push().mutable_summary();
  summary.set_queue_ms(stats_.queue_ms);
  summary.set_bind_ms(bind_ms_);
  summary.set_solve_ms(stats_.solve_ms);
  summary.set_encode_ms(stats_.encode_ms);
  summary.set_wall_ms(elapsed_ms(accepted_));
  summary.set_bytes(stats_.bytes);
  summary.set_prepared_again(prepared_again_);
  summary.set_prepare_ms(stats_.prepare_ms);
  if (fell_back_ > 0) {
    summary.add_notes(std::to_string(fell_back_) +
                      " blocks are in RAW_F64: their integers at this tolerance exceed the range of the encoding");
  }
  produced_ = true;
  slot_.leave();
  parts_.on_served(bound_->plan.designs - failed_);
}

void DeformCall::on_taken(const v1::DeformReply& reply) {
  if (!reply.has_block()) return;
  buffered_bytes_ -= reply.block().data().size();
  const bool low = buffered_bytes_ <= bound_->plan.high_water(parts_.scheduler->workers()) / 2;
  if (low && !slot_.held() && !produced_) schedule_steps();
}

void DeformCall::drop() {
  finished_.clear();
  whole_.clear();
  bound_.reset();
}

}  // namespace deform::server
