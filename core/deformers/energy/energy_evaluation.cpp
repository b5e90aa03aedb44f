// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/energy_evaluation.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <string>

#include "core/base/vectors.h"
#include "core/deformers/handles/turn_warnings.h"

namespace deform {

namespace {

constexpr std::size_t energy_places_per_task = 1024;
constexpr double exact_limit = 1e-9;      // of D: ConstraintReport::missed
constexpr double convergence_margin = 4;  // true error against the way to the solution as it is estimated

}  // namespace

EnergyEvaluation::EnergyEvaluation(std::shared_ptr<const EnergySystem> system, std::span<const Design> designs,
                                   EvaluationPath path, WarmStart* warm, const RunContext& context)
    : HandleEvaluation(system, designs, path, context), system_(*system), solutions_(designs.size()) {
  for (std::size_t i = 0; i < designs.size() && system_.model_.of_shell; ++i) {
    add_turn_warnings(system_.setup_, designs_[i], reports_[i]);
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
  const auto change = system_.prescribed(designs_[0], kind_);
  const Eigen::MatrixXd w = system_.constrained_->derivative(at.result, change.h, change.offsets, context);
  solutions_[0] = system_.completed(change.h * D, w * D, context);
  if (!system_.exact_) return;
  solutions_[0].exact = system_.exact_->derivative(at.exact, solutions_[0].field, designs_[0], context);
}

void EnergyEvaluation::solve(const RunContext& context) {
  for_each_direct(context, [&](std::size_t i) {
    solutions_[i] = system_.solve(system_.prescribed(designs_[i], kind_).h * system_.box_.scale, context);
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
  const auto to = system_.prescribed(designs_[design], kind_);
  const auto* start = warm != nullptr ? static_cast<const ConstrainedStart*>(warm->state.get()) : nullptr;
  const ConstrainedResult result = system_.constrained_->solve(to.h, to.offsets, context, start);
  if (warm != nullptr) warm->state = std::make_shared<const ConstrainedStart>(result.start());
  solutions_[design] = system_.completed(to.h * D, result.w * D, context);
  EnergySystem::Solution& solution = solutions_[design];
  if (system_.exact_) solution.exact = system_.exact_->place(solution.field, designs_[design], result.after.shapes, context);
  report_misfit(design);
  DesignReport& report = reports_[design];
  report.iterations = result.iterations;
  report.newton_steps = result.newton_steps;
  report.converged = result.converged;
  report.energy = result.after.objective;
  report.convergence_error = result.error * D;
  double left = 0;
  for (const Eigen::MatrixXd& w : result.left) left += system_.largest_displacement(w * D, context);
  const double missed = system_.hard_handles() ? report.interpolation_residual : 0;
  set_error(design, convergence_margin * left + system_.linear_error_ * report.prescribed_displacement + missed);
  measure_constraints(design, result);
}

/// Where the points of the sets end, unit coordinates. They are computed from the same field as the points that are delivered, in
/// the same order of sums as those from which ExactStep starts: points of the solver differ from them by the rounding of its own
/// sums, which the condition of the energy amplifies, and sets that keep their place would seem to have moved.
std::vector<Vec3> EnergyEvaluation::final_points(std::size_t design) const {
  const EnergySystem::Solution& solution = solutions_[design];
  const FunctionRows functions = system_.model_.space.functions();
  std::vector<PointId> set_ids;
  for (const ConstraintSet& set : system_.constrained_->sets()) set_ids.insert(set_ids.end(), set.ids.begin(), set.ids.end());
  std::vector<Vec3> points(set_ids.size());
  std::vector<double> values(3 * tile_size, 0.0);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i % tile_size == 0 && system_.set_places_.tiles() > 0) {
      const double* tile = system_.set_places_.tile(i / tile_size);
      std::fill(values.begin(), values.end(), 0.0);
      if (system_.correction_) system_.correction_->add_values(tile, solution.field.correction.data(), 3, values.data());
      if (system_.exact_) system_.exact_->add_values(tile, solution.exact, values.data());
    }
    points[i] = system_.box_.to_unit(system_.mesh_->points[set_ids[i]]);
    for (std::size_t k = 0; k < 3; ++k) {
      double value = values[k * tile_size + i % tile_size];
      functions.for_each(set_ids[i], [&](std::int64_t column, double weight) {
        value += weight * solution.field.w(column, static_cast<Eigen::Index>(k));
      });
      points[i][k] += value / system_.box_.scale;
    }
  }
  std::size_t i = 0;
  for (const ConstraintSet& set : system_.constrained_->sets()) {
    for (const PointId id : set.ids) {
      if (system_.is_prescribed(id)) {
        points[i] = system_.box_.to_unit(held_.place(designs_[design], id, kind_));
      } else if (!solution.exact.values.empty()) {
        const std::vector<PointId>& ids = system_.exact_->ids();
        const auto found = std::lower_bound(ids.begin(), ids.end(), id);
        if (found != ids.end() && *found == id)
          points[i] = solution.exact.placed.points[static_cast<std::size_t>(found - ids.begin())];
      }
      ++i;
    }
  }
  return points;
}

void EnergyEvaluation::measure_constraints(std::size_t design, const ConstrainedResult& result) {
  const double D = system_.box_.scale;
  const std::vector<Vec3> points = final_points(design);
  std::vector<ConstraintReport>& reports = reports_[design].constraints;
  reports.resize(system_.setup_.constraints.size());
  std::vector<std::size_t> counts(reports.size(), 0);
  std::size_t first = 0;
  for (std::size_t t = 0; t < system_.constrained_->sets().size(); ++t) {
    const ConstraintSet& set = system_.constrained_->sets()[t];
    const std::size_t count = set.ids.size();
    std::vector<Vec3> projected(count);
    ShapeParameters shape = result.after.shapes[t];
    ConstraintReport& report = reports[system_.constraint_of_[t]];
    const std::span<const Vec3> x{points.data() + first, count};
    set.projection->project(x, projected, shape);
    const Projection::Misfit after = set.projection->misfit(x, projected);
    const Projection::Misfit before =
        set.projection->misfit({result.before.points.data() + first, count}, {result.before.targets.data() + first, count});
    report.rms += after.squares;
    report.rms_before += before.squares;
    report.max = std::max(report.max, D * after.largest);
    report.max_before = std::max(report.max_before, D * before.largest);
    counts[system_.constraint_of_[t]] += after.count;
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
  if (!system_.exact_) return;
  const std::vector<PointId>& ids = system_.exact_->ids();
  const auto start = std::lower_bound(ids.begin(), ids.end(), static_cast<std::uint64_t>(begin)) - ids.begin();
  for (auto u = static_cast<std::size_t>(start); u < ids.size() && ids[u] < end; ++u) {
    if (!system_.exact_->moves(u)) continue;
    for (std::size_t k = 0; k < out.size(); ++k) {
      const std::vector<Vec3>& values = solutions_[first + k].exact.values;
      if (!values.empty()) out[k][ids[u] - begin] = values[u];
    }
  }
}

std::vector<std::pair<PointId, Vec3>> EnergyEvaluation::replaced() const {
  std::vector<std::pair<PointId, Vec3>> result;
  if (!system_.exact_ || solutions_[0].exact.values.empty()) return result;
  const std::vector<PointId>& ids = system_.exact_->ids();
  for (std::size_t u = 0; u < ids.size(); ++u) {
    if (system_.exact_->moves(u)) result.emplace_back(ids[u], solutions_[0].exact.values[u]);
  }
  return result;
}

/// The sums of EnergySystem::fill_tile(), in its order.
SpaceMap::Told EnergyEvaluation::displacements_at(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
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
