// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/energy_evaluation.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <string>

#include "core/base/vectors.h"
#include "core/deformers/constrained/held_misfit.h"
#include "core/deformers/handles/motion_warnings.h"

namespace deform {

namespace {

constexpr std::size_t energy_places_per_task = 1024;
constexpr double exact_limit = 1e-9;      // of D: ConstraintReport::missed
constexpr double told_miss = 0.01;        // of the largest prescribed displacement: ConstraintReport::held_misfit
constexpr double convergence_margin = 4;  // true error against the way to the solution as it is estimated

void add_heights(const std::vector<double>& heights, std::optional<ConstraintReport::Heights>& range) {
  for (const double height : heights) {
    if (!range) range = {height, height};
    range->add(height);
  }
}

}  // namespace

EnergyEvaluation::EnergyEvaluation(std::shared_ptr<const EnergySystem> system, std::span<const Design> designs,
                                   EvaluationPath path, WarmStart* warm, const RunContext& context)
    : HandleEvaluation(system, designs, path, context), system_(*system), solutions_(designs.size()) {
  for (std::size_t i = 0; i < designs.size(); ++i) {
    add_motion_warnings(system_.held(), system_.model_.motions, designs_[i], reports_[i]);
  }
  if (system_.constrained_ == nullptr) {
    solve(context);
  } else if (warm == nullptr) {
    for_each_direct(context, [&](std::size_t i) { solve_constrained(i, nullptr, context); });
  } else {
    for (std::size_t i = 0; i < designs.size(); ++i) solve_constrained(i, warm, context);
  }
}

EnergyEvaluation::EnergyEvaluation(std::shared_ptr<const EnergySystem> system, const std::vector<Affine>& derivatives,
                                   const EnergySystem::Constrained& at, const RunContext& context)
    : HandleEvaluation(system, derivatives), system_(*system), solutions_(1) {
  if (system_.constrained_ == nullptr) {
    solve(context);
    return;
  }
  const double D = system_.box_.scale;
  const auto change = system_.prescribed(designs_[0], kind_, context);
  const Eigen::MatrixXd w = system_.constrained_->derivative(at.result, change.h, change.offsets, context);
  solutions_[0] = system_.completed(change.h * D, w * D, context);
  EnergySystem::Solution& solution = solutions_[0];
  if (system_.exact_) solution.exact = system_.exact_->derivative(at.exact, solution.field, designs_[0], context);
  if (at.layers.empty()) return;
  const std::vector<Vec3> before = system_.layer_points(system_.set_points(solution, designs_[0], kind_));
  solution.layers = system_.layers_->derivative(at.layers, before, context);
}

void EnergyEvaluation::solve(const RunContext& context) {
  for_each_direct(context, [&](std::size_t i) {
    solutions_[i] = system_.solve(system_.prescribed(designs_[i], kind_, context).h * system_.box_.scale, context);
    report_misfit(i);
    const auto error = [&](std::size_t c) { return system_.error(solutions_[i], c); };
    set_error(i, norm({error(0), error(1), error(2)}));
  });
}

void EnergyEvaluation::report_misfit(std::size_t design) {
  const auto& misfits = solutions_[design].misfits;
  reports_[design].interpolation_residual = norm({misfits[0], misfits[1], misfits[2]});
}

void EnergyEvaluation::solve_constrained(std::size_t design, WarmStart* warm, const RunContext& context) {
  const double D = system_.box_.scale;
  const auto to = system_.prescribed(designs_[design], kind_, context);
  const auto* start = warm != nullptr ? static_cast<const ConstrainedStart*>(warm->state.get()) : nullptr;
  const ConstrainedResult result = system_.constrained_->solve(to.h, to.offsets, context, start);
  if (warm != nullptr) warm->state = std::make_shared<const ConstrainedStart>(result.start());
  solutions_[design] = system_.completed(to.h * D, result.w * D, context);
  EnergySystem::Solution& solution = solutions_[design];
  if (system_.exact_) solution.exact = system_.exact_->place(solution.field, designs_[design], result.after.shapes, context);
  if (system_.layers_) {
    std::vector<Vec3> before = system_.layer_points(system_.set_points(solution, designs_[design], kind_));
    solution.layers = system_.layers_->place(std::move(before), context);
  }
  report_misfit(design);
  DesignReport& report = reports_[design];
  report.iterations = result.iterations;
  report.newton_steps = result.newton_steps;
  report.converged = result.converged;
  report.at_rounding = result.at_rounding;
  report.energy = result.after.objective;
  report.convergence_error = result.error * D;
  double left = 0;
  for (const Eigen::MatrixXd& w : result.left) left += system_.largest_displacement(w * D, context);
  const double missed = system_.hard_handles() ? report.interpolation_residual : 0;
  // Constraints may move points much farther than any handle.
  const double motion = std::max(report.prescribed_displacement, system_.largest_displacement(result.w * D, context));
  set_error(design, convergence_margin * left + system_.linear_error_ * motion + missed);
  measure_constraints(design, result, context);
}

namespace {

Projection::Misfit misfit_of(const ConstraintSet& set, std::span<const Vec3> x, ShapeParameters shape) {
  std::vector<Vec3> projected(x.size());
  set.projection->project(x, projected, shape);
  return set.projection->misfit(x, projected);
}

}  // namespace

/// What handles and fixed regions hold of the points of a set, and what these points miss by themselves.
void EnergyEvaluation::measure_held(const ConstraintSet& set, std::span<const Vec3> x, const ShapeParameters& shape,
                                    double prescribed, ConstraintReport& report) const {
  if (set.column) return;
  std::vector<std::size_t> counts(system_.setup_.handles.size() + 1);
  std::vector<char> held(set.ids.size());
  for (std::size_t i = 0; i < held.size(); ++i) {
    if (!system_.is_prescribed(set.ids[i])) continue;
    held[i] = 1;
    const RegionIndex region = system_.points_.region_of[set.ids[i]];
    ++counts[region == fixed_region ? counts.size() - 1 : static_cast<std::size_t>(region)];
  }
  for (std::size_t h = 0; h < counts.size(); ++h) {
    if (counts[h] > 0) report.held.push_back({h + 1 < counts.size() ? h : ConstraintReport::Held::fixed, counts[h]});
  }
  if (report.held.empty() || !(report.max > told_miss * prescribed)) return;
  const double D = system_.box_.scale;
  const Projection::Misfit misfit = held_misfit(*set.projection, x, held, shape);
  report.held_misfit = {D * misfit.largest,
                        D * std::sqrt(misfit.squares / static_cast<double>(std::max<std::size_t>(1, misfit.count)))};
}

void EnergyEvaluation::measure_constraints(std::size_t design, const ConstrainedResult& result, const RunContext& context) {
  const double D = system_.box_.scale;
  const std::vector<ConstraintSet>& sets = system_.constrained_->sets();
  const std::vector<Vec3> points = system_.set_points(solutions_[design], designs_[design], kind_);
  // Where they are without constraints, as they would be delivered. Points of the solver are that without a correction.
  std::vector<Vec3> before;
  if (system_.correction_ ||
      std::any_of(sets.begin(), sets.end(), [](const ConstraintSet& set) { return set.column != nullptr; })) {
    const auto to = system_.prescribed(designs_[design], kind_, context);
    before = system_.set_points(system_.completed(to.h * D, result.free * D, context), designs_[design], kind_);
  }
  std::vector<ConstraintReport>& reports = reports_[design].constraints;
  reports.resize(system_.setup_.constraints.size());
  std::vector<std::size_t> counts(reports.size(), 0);
  std::size_t first = 0;
  for (std::size_t t = 0; t < sets.size(); ++t) {
    const ConstraintSet& set = sets[t];
    const std::size_t count = set.ids.size();
    ConstraintReport& report = reports[system_.constraint_of_[t]];
    const std::span<const Vec3> x{points.data() + first, count};
    const Projection::Misfit after = misfit_of(set, x, result.after.shapes[t]);
    Projection::Misfit free;
    if (before.empty()) {
      free = set.projection->misfit({result.before.points.data() + first, count}, {result.before.targets.data() + first, count});
    } else {
      const std::span<const Vec3> at{before.data() + first, count};
      free = misfit_of(set, at, set.column ? ShapeParameters{} : result.before.shapes[t]);
      if (set.column) {
        add_heights(set.column->relative_heights(x), report.heights);
        add_heights(set.column->relative_heights(at), report.heights_before);
      }
    }
    report.rms += after.squares;
    report.rms_before += free.squares;
    report.max = std::max(report.max, D * after.largest);
    report.max_before = std::max(report.max_before, D * free.largest);
    counts[system_.constraint_of_[t]] += after.count;
    measure_held(set, x, result.after.shapes[t], reports_[design].prescribed_displacement, report);
    first += count;
  }
  const std::vector<bool>& given_up = solutions_[design].exact.placed.given_up;
  for (std::size_t t = 0; t < given_up.size(); ++t) {
    ConstraintReport& report = reports[system_.exact_->constraint_of()[t]];
    report.given_up = report.given_up || given_up[t];
  }
  for (std::size_t i = 0; i < reports.size(); ++i) {
    reports[i].rms = D * std::sqrt(reports[i].rms / std::max(1.0, static_cast<double>(counts[i])));
    reports[i].rms_before = D * std::sqrt(reports[i].rms_before / std::max(1.0, static_cast<double>(counts[i])));
    reports[i].missed = system_.setup_.constraints[i].exact && reports[i].max > exact_limit * D;
  }
}

void EnergyEvaluation::direct_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const {
  for (std::size_t k = 0; k < count; ++k) system_.fill_tile(solutions_[first + k], tile, values + 3 * k * tile_size);
}

void EnergyEvaluation::replace_points(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const {
  const auto replace = [&](const auto& step, const auto& moves, auto part) {
    const std::vector<PointId>& ids = step.ids();
    const auto start = std::lower_bound(ids.begin(), ids.end(), static_cast<std::uint64_t>(begin)) - ids.begin();
    for (auto u = static_cast<std::size_t>(start); u < ids.size() && ids[u] < end; ++u) {
      if (!moves(u)) continue;
      for (std::size_t k = 0; k < out.size(); ++k) {
        const std::vector<Vec3>& values = (solutions_[first + k].*part).values;
        if (!values.empty()) out[k][ids[u] - begin] = values[u];
      }
    }
  };
  const ExactStep* const exact = system_.exact_.get();
  const LayerStep* const layers = system_.layers_.get();
  if (exact != nullptr)
    replace(
        *exact, [&](std::size_t u) { return exact->moves(u); }, &EnergySystem::Solution::exact);
  if (layers != nullptr)
    replace(
        *layers, [&](std::size_t u) { return layers->follows(u); }, &EnergySystem::Solution::layers);
}

std::vector<std::pair<PointId, Vec3>> EnergyEvaluation::replaced() const {
  std::map<PointId, Vec3> result;
  const EnergySystem::Solution& solution = solutions_[0];
  for (std::size_t u = 0; u < solution.exact.values.size(); ++u) {
    if (system_.exact_->moves(u)) result.insert_or_assign(system_.exact_->ids()[u], solution.exact.values[u]);
  }
  for (std::size_t u = 0; u < solution.layers.values.size(); ++u) {
    if (system_.layers_->follows(u)) result.insert_or_assign(system_.layers_->ids()[u], solution.layers.values[u]);
  }
  return {result.begin(), result.end()};
}

/// The sums of EnergySystem::fill_tile(), in its order.
SpaceMap::Found EnergyEvaluation::displacements_at(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                                   const RunContext& context) const {
  const EnergySystem::Solution& solution = solutions_[0];
  const double* const w = solution.field.w.data();
  std::atomic<std::size_t> still = 0;
  parallel_for(context, points.size(), energy_places_per_task, [&](std::size_t begin, std::size_t end) {
    const auto some = points.subspan(begin, end - begin);
    std::vector<Vec3> places;
    for (const Vec3& x : some) places.push_back(system_.box_.to_unit(x));
    const TiledPoints tiled(places);
    double values[3 * tile_size];
    for (std::size_t t = 0; t < tiled.tiles(); ++t) {
      std::fill_n(values, 3 * tile_size, 0.0);
      if (system_.correction_) system_.correction_->add_values(tiled.tile(t), solution.field.correction.data(), 3, values);
      if (system_.exact_) system_.exact_->add_values(tiled.tile(t), solution.exact, values);
      for (std::size_t i = t * tile_size; i < std::min((t + 1) * tile_size, some.size()); ++i) {
        for (std::size_t k = 0; k < 3; ++k) out[begin + i][k] = values[k * tile_size + i % tile_size];
        if (system_.layers_) out[begin + i] = out[begin + i] + system_.layers_->carried_at(places[i], solution.layers);
      }
    }
    const auto outside =
        system_.model_.space.in_space->rows(some, first + begin, [&](std::size_t place, std::int64_t column, double value) {
          for (std::size_t k = 0; k < 3; ++k) out[begin + place][k] += value * w[3 * static_cast<std::size_t>(column) + k];
        });
    for (const std::size_t place : outside) out[begin + place] = {};
    still += outside.size();
  });
  return {still, 0};
}

}  // namespace deform
