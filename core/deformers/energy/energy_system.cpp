// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/energy_system.h"

#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <utility>

#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/deformers/constrained/constraint_sets.h"
#include "core/deformers/energy/energy_evaluation.h"
#include "core/numerics/interpolation/point_errors.h"

namespace deform {

namespace {

constexpr std::size_t basis_tiles_per_task = 64;
constexpr std::size_t checked_points = 96;  // at which errors are estimated
constexpr double noted_misfit = 1e-2;       // of a shift of the handles

/// B^T: values of the functions at the held points, one column each.
SparseMatrix transposed_rows(const FunctionRows& values, const std::vector<PointId>& ids) {
  SparseMatrix result(values.cols(), static_cast<std::int64_t>(ids.size()));
  std::vector<std::int64_t> counts(ids.size());
  for (std::size_t j = 0; j < ids.size(); ++j) counts[j] = static_cast<std::int64_t>(values.count(ids[j]));
  result.reserve(counts);
  for (std::size_t j = 0; j < ids.size(); ++j) {
    values.for_each(ids[j],
                    [&](std::int64_t column, double value) { result.insert(column, static_cast<std::int64_t>(j)) = value; });
  }
  result.makeCompressed();
  return result;
}

/// Up to HandleBasis::most_held of the held points, evenly by their number: of those that are bound, if any are.
std::vector<std::size_t> checked_places(std::span<const char> bound, std::size_t held) {
  std::vector<std::size_t> all;
  for (std::size_t j = 0; j < bound.size(); ++j) {
    if (bound[j]) all.push_back(j);
  }
  if (all.empty()) {
    all.resize(held);
    std::iota(all.begin(), all.end(), std::size_t{0});
  }
  std::vector<std::size_t> result(std::min(HandleBasis::most_held, all.size()));
  for (std::size_t s = 0; s < result.size(); ++s) result[s] = all[s * all.size() / result.size()];
  return result;
}

/// Gives the system what malloc() keeps of the temporaries of large spaces and constraints, several times the bytes of what was
/// made: beside what is made next they would be the peak, which the estimate does not count.
void give_back_assembly(std::size_t bytes) {
  constexpr std::size_t large = std::size_t{1} << 20;
  if (bytes >= large) malloc_trim(0);
}

}  // namespace

EnergySystem::EnergySystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const EnergyOptions& options,
                           const MakeEnergyModel& model, const RunContext& context, std::size_t memory_budget)
    : HandleSystem(std::move(mesh), setup, options.handles, Unit::diagonal, context), options_(options) {
  ConstraintSets constraints = constraint_sets(*mesh_, setup_, regions_, box_);
  end_stage("select");
  context.check();
  context.progress("assemble", 0);
  {
    EnergyModel made = model(points_.region_of, box_.scale);
    swap(model_, made);
  }
  if (model_.may_crack) points_.coincident.clear();
  give_back_assembly(sparse_bytes(model_.space.energy));
  end_stage("assemble");
  context.progress("factor", 0);
  prepare_solver(context, memory_budget);
  end_stage("factor");
  if (!constraints.sets.empty()) {
    context.progress("constraints", 0);
    prepare_constraints(std::move(constraints), context, memory_budget);
    end_stage("constraints");
  }
  prepare_basis(context, memory_budget);
  end_stage("basis");
  fill_info();
}

void EnergySystem::prepare_solver(const RunContext& context, std::size_t memory_budget) {
  EnergySolver::Problem problem;
  problem.energy.swap(model_.space.energy);
  if (model_.eliminated) {
    // The solution is -K^-1 coupling h.
    problem.coupling = -model_.coupling;
    SparseMatrix().swap(model_.coupling);
  } else {
    problem.coupling = transposed_rows(model_.space.functions(), model_.held);
    problem.enforcement = hard_handles() ? HandleEnforcement::multipliers : HandleEnforcement::soft;
    problem.weights = Eigen::VectorXd::Ones(static_cast<Eigen::Index>(model_.held.size()));
    if (hard_handles()) {
      // Stored systems count points that nearly coincide one by one, and functions that are rounding.
      const bool joins = options_.misfit == MisfitRule::joins;
      if (joins) problem.weights = ResidualCorrection::shares_of(unit_places(*mesh_, box_, model_.held), context);
      problem.weights = multiplier_weights(problem.energy, problem.coupling, problem.weights,
                                           joins ? TouchedFunctions::by_size : TouchedFunctions::above_zero);
    }
    for (std::size_t j = 0; j < model_.held.size() && !hard_handles(); ++j) {
      const RegionIndex region = points_.region_of[model_.held[j]];
      const std::size_t count = region == fixed_region ? regions_.fixed.size() : regions_.handles[region].size();
      problem.weights[static_cast<Eigen::Index>(j)] = options_.fixing / static_cast<double>(count);
    }
  }
  const std::size_t used = model_.space.value_bytes() + sparse_bytes(problem.energy) + sparse_bytes(problem.coupling);
  const std::size_t limit = memory_budget == 0 ? 0 : std::max<std::size_t>(1, memory_budget - std::min(memory_budget, used));
  solver_ = std::make_unique<const EnergySolver>(std::move(problem), limit, context);
  samples_ = check_points(unit_places(*mesh_, box_, following()), unit_places(*mesh_, box_, model_.held), checked_points);
  if (model_.eliminated || model_.held.empty()) return;
  checked_ = checked_places({}, model_.held.size());
  if (!hard_handles()) return;
  std::vector<char> bound;
  if (options_.misfit == MisfitRule::joins) {
    const std::vector<char> next = next_to_deformable(*mesh_, points_.region_of);
    for (const PointId id : model_.held) bound.push_back(next[id]);
  }
  correction_ = std::make_unique<const ResidualCorrection>(unit_places(*mesh_, box_, model_.held),
                                                           ResidualCorrection::centres_for(following().size()), bound, context);
  checked_ = checked_places(bound, model_.held.size());
  following_places_ = TiledPoints(unit_places(*mesh_, box_, following()));
  const Eigen::MatrixXd shifts = shifted_handles(driven_groups(setup_));
  missed_ = misfit(shifts, solver_->solve(shifts, context)).cwiseAbs().maxCoeff();
}

/// A load: the handles shifted by one, in directions that alternate with their groups.
Eigen::MatrixXd EnergySystem::shifted_handles(const std::vector<std::size_t>& group_of) const {
  Eigen::MatrixXd shifts = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(model_.held.size()), 1);
  for (std::size_t j = 0; j < model_.held.size(); ++j) {
    const RegionIndex region = points_.region_of[model_.held[j]];
    if (region != fixed_region) shifts(static_cast<Eigen::Index>(j), 0) = group_of[region] % 2 == 0 ? 1 : -1;
  }
  return shifts;
}

void EnergySystem::prepare_constraints(ConstraintSets constraints, const RunContext& context, std::size_t memory_budget) {
  constraint_of_ = std::move(constraints.constraint_of);
  model_.space.notes.insert(model_.space.notes.end(), constraints.notes.begin(), constraints.notes.end());
  const std::size_t limit =
      memory_budget == 0 ? 0 : std::max<std::size_t>(1, memory_budget - std::min(memory_budget, solver_->bytes()));
  ConstrainedSolver::Options options;
  options.tolerance = setup_.constraint_options.tolerance;
  options.most_iterations = setup_.constraint_options.iterations;
  {
    const std::optional<DeliveredRows> delivered = delivered_rows(constraints.sets, context);
    delivered_ = delivered.has_value();
    constrained_ = std::make_unique<const ConstrainedSolver>(*solver_, model_.space.functions(), std::move(constraints.sets),
                                                             options, limit, context, delivered ? &*delivered : nullptr);
  }
  give_back_assembly(constrained_->bytes());
  std::vector<std::size_t> each(frames_.size());
  std::iota(each.begin(), each.end(), std::size_t{0});
  linear_error_ = solve(shifted_handles(each), context).errors[0];
  prepare_steps(context);
  if (!correction_ && !exact_) return;
  std::vector<Vec3> places;
  for (const ConstraintSet& set : constrained_->sets()) places.insert(places.end(), set.rest.begin(), set.rest.end());
  set_places_ = TiledPoints(places);
}

/// For constraints on the points that are delivered: what the correction does to them. Stored systems and those of too many
/// points and functions have none, and meet constraints before the correction.
std::optional<DeliveredRows> EnergySystem::delivered_rows(const std::vector<ConstraintSet>& sets, const RunContext& context) {
  const bool columns = std::all_of(sets.begin(), sets.end(), [](const ConstraintSet& set) { return set.column != nullptr; });
  const bool stored = options_.misfit != MisfitRule::joins || setup_.constraint_options.exact_steps != ExactSteps::joins;
  if (!correction_ || columns || stored) return {};
  std::vector<bool> prescribed(mesh_->point_count());
  for (std::size_t i = 0; i < prescribed.size(); ++i) prescribed[i] = is_prescribed(static_cast<PointId>(i));
  DeliveredRows result;
  result.take_points(sets, prescribed);
  const SparseRows misfits(solver_->problem().coupling);
  for (std::int64_t j = 0; j < misfits.rows(); ++j) {
    if (misfits.outerIndexPtr()[j] < misfits.outerIndexPtr()[j + 1]) result.functions.push_back(j);
  }
  const std::size_t reaching = functions_reaching(model_.space.functions(), sets, &result).size();
  const std::size_t factor_entries = solver_->factor().bytes() / sizeof(double);
  if (DeliveredRows::form(result.points(), reaching, solver_->unknowns(), factor_entries) == DeliveredRows::Form::none) {
    model_.space.notes.push_back("Constraints of " + std::to_string(result.points()) + " points with " +
                                 std::to_string(solver_->unknowns()) +
                                 " functions are solved for without what is interpolated of the misfit at the handles, which may "
                                 "move their points off the shapes again.");
    return {};
  }
  result.interpolated = correction_->values(misfits, result.functions, unit_places(*mesh_, box_, result.ids), context);
  return result;
}

/// Those that follow the solution of a design.
void EnergySystem::prepare_steps(const RunContext& context) {
  const std::vector<ConstraintSet>& sets = constrained_->sets();
  std::vector<char> keeps(mesh_->point_count());
  bool exact = false;
  for (std::size_t t = 0; t < sets.size(); ++t) {
    if (!setup_.constraints[constraint_of_[t]].exact) continue;
    exact = true;
    for (const PointId id : sets[t].ids) keeps[id] = 1;
  }
  const bool columns = std::any_of(sets.begin(), sets.end(), [](const ConstraintSet& set) { return set.column != nullptr; });
  if (columns)
    layers_ = std::make_unique<const LayerStep>(LayerStep::Input{*mesh_, box_, following(), sets, keeps, flat_}, context);
  if (layers_ && layers_->empty()) layers_ = nullptr;
  if (!exact) return;
  if (!correction_) following_places_ = TiledPoints(unit_places(*mesh_, box_, following()));
  const DeformationBefore before{
      held(), box_, model_.held, following(), following_places_, model_.space.functions(), correction_.get(), hard_handles()};
  exact_ = std::make_unique<const ExactStep>(before, sets, constraint_of_, context);
}

/// They are computed from the same field as the points that are delivered, in the same order of sums as those from which
/// ExactStep starts: points of the solver differ from them by the rounding of its own sums, which the condition of the energy
/// amplifies, and sets that keep their place would seem to have moved.
std::vector<Vec3> EnergySystem::set_points(const Solution& solution, const BoundDesign& design, MotionKind kind) const {
  const bool positions = kind == MotionKind::position;
  const HeldPoints held_points = held();
  const FunctionRows functions = model_.space.functions();
  const auto in_unit = [&](const Vec3& p) { return positions ? box_.to_unit(p) : p / box_.scale; };
  const auto find = [](const std::vector<PointId>& ids, PointId id) {
    const auto found = std::lower_bound(ids.begin(), ids.end(), id);
    return found != ids.end() && *found == id ? static_cast<std::size_t>(found - ids.begin()) : ids.size();
  };
  std::vector<PointId> set_ids;
  for (const ConstraintSet& set : constrained_->sets()) set_ids.insert(set_ids.end(), set.ids.begin(), set.ids.end());
  std::vector<Vec3> points(set_ids.size(), Vec3{});
  std::vector<double> values(3 * tile_size, 0.0);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i % tile_size == 0 && set_places_.tiles() > 0) {
      const double* tile = set_places_.tile(i / tile_size);
      std::fill(values.begin(), values.end(), 0.0);
      if (correction_) correction_->add_values(tile, solution.field.correction.data(), 3, values.data());
      if (exact_) exact_->add_values(tile, solution.exact, values.data());
    }
    if (positions) points[i] = box_.to_unit(mesh_->points[set_ids[i]]);
    for (std::size_t k = 0; k < 3; ++k) {
      double value = values[k * tile_size + i % tile_size];
      functions.for_each(set_ids[i], [&](std::int64_t column, double weight) {
        value += weight * solution.field.w(column, static_cast<Eigen::Index>(k));
      });
      points[i][k] += value / box_.scale;
    }
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    const PointId id = set_ids[i];
    if (is_prescribed(id)) {
      points[i] = in_unit(held_points.place(design, id, kind));
      continue;
    }
    const std::size_t in_exact = solution.exact.values.empty() ? 0 : find(exact_->ids(), id);
    if (in_exact < solution.exact.values.size()) {
      points[i] = positions ? solution.exact.placed.points[in_exact] : in_unit(solution.exact.values[in_exact]);
    }
    const std::size_t in_layers = solution.layers.values.empty() ? 0 : find(layers_->ids(), id);
    if (in_layers < solution.layers.values.size()) {
      points[i] = in_unit(solution.layers.values[in_layers]);
    } else if (const std::size_t slot = layers_ ? layers_->slot(id) : following().size(); slot < following().size()) {
      points[i] = points[i] + layers_->carried(slot, solution.layers) / box_.scale;
    }
  }
  return points;
}

std::vector<Vec3> EnergySystem::layer_points(const std::vector<Vec3>& of_sets) const {
  const std::vector<PointId>& ids = layers_->ids();
  std::vector<Vec3> result(ids.size());
  std::size_t i = 0;
  for (const ConstraintSet& set : constrained_->sets()) {
    for (const PointId id : set.ids) {
      const Vec3& x = of_sets[i++];
      const auto found = set.column ? std::lower_bound(ids.begin(), ids.end(), id) : ids.end();
      if (found != ids.end() && *found == id) result[static_cast<std::size_t>(found - ids.begin())] = x;
    }
  }
  return result;
}

EnergySystem::Prescribed EnergySystem::prescribed(const BoundDesign& design, MotionKind kind, const RunContext& context) const {
  const HeldPoints points = held();
  const auto displacement = [&](PointId id) {
    const Vec3 u = points.displacement(design, id, kind);
    return Vec3{u[0] / box_.scale, u[1] / box_.scale, u[2] / box_.scale};
  };
  Prescribed result{Eigen::MatrixXd(static_cast<Eigen::Index>(model_.held.size()), 3), {}};
  for (std::size_t j = 0; j < model_.held.size(); ++j) {
    const Vec3 u = displacement(model_.held[j]);
    for (std::size_t k = 0; k < 3; ++k) result.h(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) = u[k];
  }
  if (!constrained_) return result;
  if (delivered_) result.offsets = offsets_of(result.h, context);
  std::size_t i = 0;
  for (const ConstraintSet& set : constrained_->sets()) {
    for (const PointId id : set.ids) {
      const bool is_held = (model_.eliminated || is_delivered(set)) && points_.region_of[id] != deformable_region;
      if (!delivered_) result.offsets.emplace_back(Vec3{});
      if (is_held) result.offsets[i] = displacement(id);
      if (!is_held && !is_delivered(set)) result.offsets[i] = {};
      ++i;
    }
  }
  return result;
}

/// What the correction makes of h at the points of the sets: their displacements when all functions are zero.
std::vector<Vec3> EnergySystem::offsets_of(const Eigen::MatrixXd& h, const RunContext& context) const {
  const RowMajorMatrix coefficients = correction_->coefficients(h, context);
  std::size_t count = 0;
  for (const ConstraintSet& set : constrained_->sets()) count += set.ids.size();
  std::vector<Vec3> result(count);
  constexpr std::size_t tiles_per_task = 16;
  parallel_for(context, set_places_.tiles(), tiles_per_task, [&](std::size_t begin, std::size_t end) {
    double values[3 * tile_size];
    for (std::size_t t = begin; t < end; ++t) {
      std::fill_n(values, 3 * tile_size, 0.0);
      correction_->add_values(set_places_.tile(t), coefficients.data(), 3, values);
      for (std::size_t i = t * tile_size; i < std::min((t + 1) * tile_size, count); ++i) {
        for (std::size_t k = 0; k < 3; ++k) result[i][k] = values[k * tile_size + i % tile_size];
      }
    }
  });
  return result;
}

Eigen::MatrixXd EnergySystem::misfit(const Eigen::MatrixXd& h, const Eigen::MatrixXd& w) const {
  return h - solver_->problem().coupling.transpose() * w;
}

EnergySystem::Solution EnergySystem::solve(const Eigen::MatrixXd& h, const RunContext& context) const {
  const Eigen::MatrixXd u = solver_->loads(h, context);
  const Eigen::MatrixXd w = solver_->solve_loads(u, context);
  Solution solution = completed(h, w, context);
  const Eigen::MatrixXd uncertainty = solver_->uncertainty(u, w, context);
  EnergyField change{uncertainty, {}};
  if (correction_)
    change.correction = correction_->smooth_coefficients(misfit(Eigen::MatrixXd::Zero(h.rows(), h.cols()), uncertainty), context);
  measure_errors(change, solution, context);
  return solution;
}

/// The values of a field at the samples, one row each.
Eigen::MatrixXd EnergySystem::at_samples(const EnergyField& field) const {
  const auto columns = static_cast<std::size_t>(field.w.cols());
  const FunctionRows functions = model_.space.functions();
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(samples_.size()), field.w.cols());
  std::vector<double> values(columns * tile_size);
  std::size_t filled = following().size();
  for (Eigen::Index i = 0; i < result.rows(); ++i) {
    const std::uint32_t s = samples_[static_cast<std::size_t>(i)];
    if (field.correction.size() > 0) {
      if (filled != s / tile_size) {
        filled = s / tile_size;
        std::fill(values.begin(), values.end(), 0.0);
        correction_->add_values(following_places_.tile(filled), field.correction.data(), columns, values.data());
      }
      for (std::size_t c = 0; c < columns; ++c) result(i, static_cast<Eigen::Index>(c)) = values[c * tile_size + s % tile_size];
    }
    functions.for_each(following()[s], [&](std::int64_t column, double value) { result.row(i) += value * field.w.row(column); });
  }
  return result;
}

/// At the points of the sets without the correction, which is for the points next to the handles, unless they are solved for with
/// it.
double EnergySystem::largest_displacement(const Eigen::MatrixXd& w, const RunContext& context) const {
  EnergyField field{w, {}};
  if (correction_) {
    const auto held_count = static_cast<Eigen::Index>(model_.held.size());
    field.correction = correction_->coefficients(misfit(Eigen::MatrixXd::Zero(held_count, w.cols()), w), context);
  }
  double largest = 0;
  const Eigen::MatrixXd samples = at_samples(field);
  for (Eigen::Index i = 0; i < samples.rows(); ++i) largest = std::max(largest, samples.row(i).norm());
  const FunctionRows functions = model_.space.functions();
  std::vector<double> values(3 * tile_size, 0.0);
  std::size_t i = 0;
  for (const ConstraintSet& set : constrained_->sets()) {
    for (const PointId id : set.ids) {
      if (delivered_ && i % tile_size == 0) {
        std::fill(values.begin(), values.end(), 0.0);
        correction_->add_values(set_places_.tile(i / tile_size), field.correction.data(), 3, values.data());
      }
      const std::size_t slot = i++ % tile_size;
      if (is_delivered(set) && is_prescribed(id)) continue;
      Eigen::RowVector3d u = Eigen::RowVector3d::Zero();
      if (is_delivered(set)) u << values[slot], values[tile_size + slot], values[2 * tile_size + slot];
      functions.for_each(id, [&](std::int64_t column, double value) { u += value * field.w.row(column); });
      largest = std::max(largest, u.norm());
    }
  }
  return largest;
}

/// Estimates errors from the uncertainty of the solution.
void EnergySystem::measure_errors(const EnergyField& change, Solution& solution, const RunContext& context) const {
  constexpr double rounding = 4 * std::numeric_limits<double>::epsilon();
  const auto columns = static_cast<std::size_t>(change.w.cols());
  solution.errors.assign(columns, 0.0);
  const FunctionRows functions = model_.space.functions();
  const Eigen::MatrixXd errors = at_samples(change);
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    for (std::size_t c = 0; c < columns; ++c) {
      double size = 0;
      functions.for_each(following()[samples_[i]], [&](std::int64_t column, double value) {
        size += std::abs(value * solution.field.w(column, static_cast<Eigen::Index>(c)));
      });
      const double error = errors(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(c));
      solution.errors[c] = std::max(solution.errors[c], std::abs(error) + rounding * size);
    }
  }
  std::vector<PointId> ids;
  for (const std::uint32_t s : samples_) ids.push_back(following()[s]);
  const std::vector<Vec3> places = correction_ ? unit_places(*mesh_, box_, ids) : std::vector<Vec3>();
  for (std::size_t c = 0; c < columns; ++c) {
    double& error = solution.errors[c];
    if (!places.empty()) {
      error += correction_->rounding(solution.field.correction.col(static_cast<Eigen::Index>(c)), places, context);
    }
    error *= error_margin;
  }
}

/// Completes a solution by the correction for the misfit of the functions to h.
EnergySystem::Solution EnergySystem::completed(const Eigen::MatrixXd& h, const Eigen::MatrixXd& w,
                                               const RunContext& context) const {
  Solution solution;
  solution.field.w = w;
  solution.misfits.assign(static_cast<std::size_t>(h.cols()), 0.0);
  if (model_.eliminated) return solution;
  if (correction_) solution.field.correction = correction_->coefficients(misfit(h, w), context);
  const Eigen::MatrixXd missed = sampled_misfit(h, solution.field, context);
  for (Eigen::Index c = 0; c < missed.cols() && missed.rows() > 0; ++c) {
    solution.misfits[static_cast<std::size_t>(c)] = missed.col(c).cwiseAbs().maxCoeff();
  }
  return solution;
}

Eigen::MatrixXd EnergySystem::sampled_misfit(const Eigen::MatrixXd& h, const EnergyField& field,
                                             const RunContext& context) const {
  const std::vector<std::size_t>& which = checked_;
  const std::size_t count = which.size();
  std::vector<Vec3> places;
  for (const std::size_t j : which) places.push_back(box_.to_unit(mesh_->points[model_.held[j]]));
  const TiledPoints tiled(places);
  const FunctionRows functions = model_.space.functions();
  const auto columns = static_cast<std::size_t>(h.cols());
  Eigen::MatrixXd missed(static_cast<Eigen::Index>(count), h.cols());
  std::vector<double> values(columns * tile_size);
  for (std::size_t t = 0; t < tiled.tiles(); ++t) {
    context.check();
    std::fill(values.begin(), values.end(), 0.0);
    if (correction_) correction_->add_values(tiled.tile(t), field.correction.data(), columns, values.data());
    for (std::size_t s = t * tile_size; s < std::min((t + 1) * tile_size, count); ++s) {
      for (std::size_t c = 0; c < columns; ++c) {
        double value = values[c * tile_size + s % tile_size];
        functions.for_each(model_.held[which[s]], [&](std::int64_t column, double weight) {
          value += weight * field.w(column, static_cast<Eigen::Index>(c));
        });
        const double target = h(static_cast<Eigen::Index>(which[s]), static_cast<Eigen::Index>(c));
        missed(static_cast<Eigen::Index>(s), static_cast<Eigen::Index>(c)) = target - value;
      }
    }
  }
  return missed;
}

void EnergySystem::fill_tile(const Solution& solution, std::size_t tile, double* out) const {
  const auto columns = static_cast<std::size_t>(solution.field.w.cols());
  std::fill_n(out, columns * tile_size, 0.0);
  if (solution.field.correction.size() > 0) {
    correction_->add_values(following_places_.tile(tile), solution.field.correction.data(), columns, out);
  }
  if (exact_) exact_->add_values(following_places_.tile(tile), solution.exact, out);
  const FunctionRows functions = model_.space.functions();
  const std::size_t end = std::min((tile + 1) * tile_size, following().size());
  for (std::size_t s = tile * tile_size; s < end; ++s) {
    functions.for_each(following()[s], [&](std::int64_t column, double value) {
      const double* w = solution.field.w.data() + static_cast<std::size_t>(column) * columns;
      for (std::size_t c = 0; c < columns; ++c) out[c * tile_size + s % tile_size] += value * w[c];
    });
    if (solution.layers.moved.empty()) continue;
    const Vec3 carried = layers_->carried(s, solution.layers);
    for (std::size_t c = 0; c < 3; ++c) out[c * tile_size + s % tile_size] += carried[c];
  }
}

Eigen::MatrixXd EnergySystem::fields_at_held(std::size_t handle) const {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(model_.held.size()), 4);
  for (std::size_t j = 0; j < model_.held.size(); ++j) {
    if (points_.region_of[model_.held[j]] != handle) continue;
    const std::array<double, 4> values = handle_fields(handle, model_.held[j]);
    for (std::size_t f = 0; f < 4; ++f) result(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(f)) = values[f];
  }
  return result;
}

/// A handle at a time: its four fields share the solution's memory.
void EnergySystem::prepare_basis(const RunContext& context, std::size_t memory_budget) {
  const std::size_t bytes = HandleBasis::bytes_for(following().size(), fields(), options_.basis_tolerance);
  if (!setup_.constraints.empty() || !wants_basis(options_.basis, bytes, solver_->bytes())) return;
  const std::size_t making = HandleBasis::peak_bytes_for(following().size(), fields(), options_.basis_tolerance);
  if (memory_budget != 0 && options_.basis == BasisMode::automatic && solver_->bytes() + making > memory_budget) return;
  HandleBasis basis{{0, 1, 2}, FieldTiles(following().size(), fields()), {}};
  const std::size_t checked = checked_.size();
  if (checked > 0) basis.checked = HandleBasis::Checked::held;
  basis.errors.resize(checked * fields());
  for (std::size_t h = 0; h < frames_.size(); ++h) {
    const Eigen::MatrixXd at_held = fields_at_held(h);
    const Solution solution = solve(at_held, context);
    if (checked > 0) {
      const Eigen::MatrixXd missed = sampled_misfit(at_held, solution.field, context);
      for (Eigen::Index s = 0; s < missed.rows(); ++s) {
        for (Eigen::Index f = 0; f < 4; ++f) {
          basis.errors[static_cast<std::size_t>(s) * fields() + 4 * h + static_cast<std::size_t>(f)] = missed(s, f);
        }
      }
    }
    basis.residuals.insert(basis.residuals.end(), solution.misfits.begin(), solution.misfits.end());
    basis.more.insert(basis.more.end(), solution.errors.begin(), solution.errors.end());
    parallel_for(context, tile_count(following().size()), basis_tiles_per_task, [&](std::size_t begin, std::size_t end) {
      for (std::size_t t = begin; t < end; ++t) fill_tile(solution, t, basis.tiles.tile(t) + 4 * h * tile_size);
    });
    context.progress("basis", static_cast<double>(h + 1) / static_cast<double>(frames_.size()));
  }
  add_basis(std::move(basis), options_.basis_tolerance, context);
}

void EnergySystem::fill_info() {
  (model_.eliminated ? info_.held_points : info_.samples) = model_.eliminated ? model_.held.size() : model_.space.samples;
  info_.functions = solver_->unknowns();
  info_.cubature_points = model_.space.cubature_points;
  info_.reduced = model_.eliminated && model_.held.size() < info_.constraint_points;
  info_.condition = 1 / std::max(solver_->factor().reciprocal_condition(), 1e-300);
  info_.design_bytes = constrained_ ? constrained_->working_bytes() : 0;
  const std::size_t checks = has_basis() ? basis_.front().errors.size() * sizeof(double) : 0;
  set_bytes(solver_->bytes() + (constrained_ ? constrained_->bytes() : 0) + (correction_ ? correction_->bytes() : 0) +
                following_places_.bytes() + set_places_.bytes() + (exact_ ? exact_->bytes() : 0) +
                (layers_ ? layers_->bytes() : 0),
            model_.space.value_bytes() + checks);
  info_.notes = model_.space.notes;
  if (info_.reduced) {
    info_.notes.push_back(std::to_string(model_.held.size()) + " of " + std::to_string(info_.constraint_points) +
                          " constraint points enter the system: those within two rings of the deformable region.");
  }
  if (missed_ > noted_misfit) {
    info_.notes.push_back("The functions miss shifts of the handles by up to " + scientific(missed_) +
                          " of them, because they are coarser than the handles; this is interpolated. More samples, centres or "
                          "control points follow the handles more closely.");
  }
  if (info_.condition > 1e13) info_.notes.push_back("The system is ill-conditioned: expect a loss of digits.");
  if (!has_basis() && setup_.constraints.empty()) {
    info_.notes.push_back("No handle basis is stored: every design is solved for.");
  }
}

std::unique_ptr<const Evaluation> EnergySystem::bind(std::span<const Design> designs, EvaluationPath path,
                                                     const RunContext& context) const {
  return std::make_unique<EnergyEvaluation>(std::static_pointer_cast<const EnergySystem>(shared_from_this()), designs, path,
                                            nullptr, context);
}

std::unique_ptr<const Evaluation> EnergySystem::bind_sequence(std::span<const Design> designs, EvaluationPath path,
                                                              WarmStart& warm, const RunContext& context) const {
  auto self = std::static_pointer_cast<const EnergySystem>(shared_from_this());
  if (warm.of.lock() != self) warm = {self, nullptr};
  return std::make_unique<EnergyEvaluation>(std::move(self), designs, path, &warm, context);
}

/// The design of some variables is solved for.
EnergySystem::Constrained EnergySystem::constrained_at(std::span<const double> variables, const RunContext& context) const {
  const Design design{{variables.begin(), variables.end()}, {}};
  const BoundDesign bound = held().bound(design, 0);
  const Prescribed to = prescribed(bound, MotionKind::position, context);
  ConstrainedResult result = constrained_->solve(to.h, to.offsets, context);
  if (!exact_ && !layers_) return {std::move(result), {}, {}};
  Solution solution = completed(to.h * box_.scale, result.w * box_.scale, context);
  if (exact_) solution.exact = exact_->place(solution.field, bound, result.after.shapes, context);
  std::vector<Vec3> layers;
  if (layers_) layers = layers_->place(layer_points(set_points(solution, bound, MotionKind::position)), context).from;
  return {std::move(result), std::move(solution.exact.placed), std::move(layers)};
}

std::unique_ptr<const Evaluation> EnergySystem::derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                                           const RunContext& context) const {
  Constrained at;
  if (constrained_) at = constrained_at(variables, context);
  return std::make_unique<EnergyEvaluation>(std::static_pointer_cast<const EnergySystem>(shared_from_this()), maps, at, context);
}

/// Handle fields at the held points, transposed, times `back` (m x 3): 4H x 3.
std::vector<double> EnergySystem::contract_fields(const Eigen::MatrixXd& back) const {
  std::vector<double> result;
  for (std::size_t h = 0; h < frames_.size(); ++h) {
    const Eigen::MatrixXd G = fields_at_held(h).transpose() * back;
    for (Eigen::Index f = 0; f < 4; ++f) {
      for (Eigen::Index k = 0; k < 3; ++k) result.push_back(G(f, k));
    }
  }
  return result;
}

HandleSystem::Fields EnergySystem::adjoint(std::span<const double> variables, Cotangents at_following,
                                           const RunContext& context) const {
  Constrained at;
  if (constrained_) at = constrained_at(variables, context);
  const std::size_t count = at_following.size();
  std::vector<std::vector<Vec3>> X(at_following.begin(), at_following.end()), at_exact(count), at_layers(count);
  for (std::size_t j = 0; j < count && !at.layers.empty(); ++j) at_layers[j] = layers_->adjoint(at.layers, X[j], context);
  for (std::size_t j = 0; j < count && exact_ && at.exact.any(); ++j) at_exact[j] = exact_->adjoint(at.exact, X[j], context);
  const auto columns = static_cast<Eigen::Index>(3 * count);
  Eigen::MatrixXd g = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(solver_->unknowns()), columns);
  for (std::size_t s = 0; s < following().size(); ++s) {
    model_.space.functions().for_each(following()[s], [&](std::int64_t column, double value) {
      for (Eigen::Index k = 0; k < columns; ++k) {
        g(column, k) += value * X[static_cast<std::size_t>(k) / 3][s][static_cast<std::size_t>(k) % 3];
      }
    });
  }
  Eigen::MatrixXd direct = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(model_.held.size()), columns);
  if (correction_) {
    // The correction interpolates h - B w, so it acts on h directly and through w.
    const std::vector<Vec3> places = unit_places(*mesh_, box_, following());
    for (std::size_t j = 0; j < count; ++j) {
      direct.middleCols(static_cast<Eigen::Index>(3 * j), 3) = correction_->adjoint(places, X[j], context);
    }
    g -= solver_->problem().coupling * direct;
  }
  Fields result;
  if (!constrained_) {
    const Eigen::MatrixXd back = direct + solver_->adjoint(g, context);
    for (std::size_t j = 0; j < count; ++j)
      result.push_back(contract_fields(back.middleCols(static_cast<Eigen::Index>(3 * j), 3)));
    return result;
  }
  for (std::size_t j = 0; j < count; ++j) {
    const auto first = static_cast<Eigen::Index>(3 * j);
    result.push_back(
        constrained_adjoint(at, g.middleCols(first, 3), direct.middleCols(first, 3), at_exact[j], at_layers[j], context));
  }
  return result;
}

/// For one cotangent, from its derivatives with respect to the coefficients, to the held points, and to the points of exact
/// constraints and of columns.
std::vector<double> EnergySystem::constrained_adjoint(const Constrained& at, const Eigen::MatrixXd& g,
                                                      const Eigen::MatrixXd& direct, const std::vector<Vec3>& at_exact,
                                                      const std::vector<Vec3>& at_layers, const RunContext& context) const {
  const ConstrainedSolver::Adjoint back = constrained_->adjoint(at.result, g, context);
  Eigen::MatrixXd at_held = direct + back.h;
  std::vector<Vec3> moved_places, moved;
  std::vector<double> of_sets(12 * frames_.size(), 0.0);
  std::size_t i = 0;
  for (const ConstraintSet& set : constrained_->sets()) {
    for (std::size_t p = 0; p < set.ids.size(); ++p) {
      const Vec3& y = back.offsets[i++];
      if (model_.eliminated || is_delivered(set)) add_fields(set.ids[p], y, of_sets);
      if (!is_delivered(set) || is_prescribed(set.ids[p])) continue;
      moved_places.push_back(set.rest[p]);
      moved.push_back(y);
    }
  }
  if (!moved.empty()) at_held += correction_->adjoint(moved_places, moved, context);
  std::vector<double> result = contract_fields(at_held);
  for (std::size_t f = 0; f < result.size(); ++f) result[f] += of_sets[f];
  for (std::size_t u = 0; u < at_exact.size(); ++u) {
    if (!exact_->moves(u)) add_fields(exact_->ids()[u], at_exact[u], result);
  }
  for (std::size_t u = 0; u < at_layers.size(); ++u) {
    if (!layers_->follows(u)) add_fields(layers_->ids()[u], at_layers[u], result);
  }
  return result;
}

/// Adds the contribution of a point with prescribed displacement to the sums over the fields.
void EnergySystem::add_fields(PointId id, const Vec3& cotangent, std::vector<double>& fields) const {
  const RegionIndex region = points_.region_of[id];
  if (region == deformable_region || region == fixed_region) return;
  const std::array<double, 4> values = handle_fields(region, id);
  for (std::size_t f = 0; f < 4; ++f) {
    for (std::size_t k = 0; k < 3; ++k) fields[3 * (4 * region + f) + k] += values[f] * cotangent[k];
  }
}

}  // namespace deform
