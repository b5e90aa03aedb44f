#include "core/deformers/energy/energy_system.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/stopwatch.h"
#include "core/deformers/constrained/constraint_sets.h"
#include "core/deformers/energy/energy_evaluation.h"
#include "core/deformers/handles/constraint_points.h"
#include "core/deformers/handles/handle_basis.h"

namespace deform {

namespace {

constexpr std::size_t most_samples = 256;  // held points at which a solution is checked
constexpr std::size_t tiles_per_task = 64;

/// B^T: values of the functions at the held points, one column each.
SparseMatrix transposed_rows(const SparseRows& values, const std::vector<PointId>& ids) {
  SparseMatrix result(values.cols(), static_cast<std::int64_t>(ids.size()));
  std::vector<std::int64_t> counts(ids.size());
  for (std::size_t j = 0; j < ids.size(); ++j) counts[j] = values.row(ids[j]).nonZeros();
  result.reserve(counts);
  for (std::size_t j = 0; j < ids.size(); ++j) {
    for (SparseRows::InnerIterator it(values, ids[j]); it; ++it) {
      result.insert(it.col(), static_cast<std::int64_t>(j)) = it.value();
    }
  }
  result.makeCompressed();
  return result;
}

}  // namespace

EnergyOptions energy_options(const Setup& setup) {
  if (const auto* shell = std::get_if<ShellOptions>(&setup.method)) return {shell->handles, shell->fixing, shell->basis};
  if (const auto* subspace = std::get_if<SubspaceOptions>(&setup.method)) {
    return {subspace->handles, subspace->fixing, subspace->basis};
  }
  const auto& mls = std::get<MlsOptions>(setup.method);
  return {mls.handles, mls.fixing, mls.basis};
}

EnergySystem::EnergySystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context,
                           std::size_t memory_budget)
    : mesh_(std::move(mesh)), setup_(setup), options_(energy_options(setup)) {
  Stopwatch watch;
  context.progress("select", 0);
  regions_ = validate(setup_, *mesh_);
  const Box bounds = bounding_box(mesh_->points);
  info_.diagonal = bounds.diagonal();
  box_ = {bounds.min, info_.diagonal > 0 ? info_.diagonal : 1};
  place_points();
  ConstraintSets constraints = constraint_sets(*mesh_, setup_, regions_, box_);
  info_.stage_seconds.emplace_back("select", watch.lap());
  context.check();
  context.progress("assemble", 0);
  {
    EnergyModel model = energy_model(*mesh_, setup_, region_of_, box_, context);
    swap(model_, model);
  }
  info_.stage_seconds.emplace_back("assemble", watch.lap());
  context.progress("factor", 0);
  prepare_solver(context, memory_budget);
  info_.stage_seconds.emplace_back("factor", watch.lap());
  prepare_constraints(std::move(constraints), context, memory_budget);
  prepare_basis(context, memory_budget);
  info_.stage_seconds.emplace_back("basis", watch.lap());
  fill_info();
}

void EnergySystem::place_points() {
  RbfOptions all;
  all.reduction = CentreReduction::off;
  RbfCentres points = choose_centres(*mesh_, regions_, all);
  region_of_ = std::move(points.region_of);
  if (!std::holds_alternative<ShellOptions>(setup_.method)) coincident_ = std::move(points.coincident);
  info_.constraint_points = points.constraint_points;
  info_.deformable_points = points.deformable.size();
  rank_of_.assign(mesh_->point_count(), 0);
  for (const auto& handle : regions_.handles) {
    for (std::size_t k = 0; k < handle.size(); ++k) rank_of_[handle[k]] = static_cast<std::uint32_t>(k);
  }
  frames_ = handle_frames(*mesh_, regions_, box_);
  for (std::size_t i = 0; i < region_of_.size(); ++i) {
    if (!exact() || region_of_[i] == deformable_region) following_.push_back(static_cast<PointId>(i));
  }
}

void EnergySystem::prepare_solver(const RunContext& context, std::size_t memory_budget) {
  EnergySolver::Problem problem;
  problem.energy.swap(model_.space.energy);
  if (model_.eliminated) {
    // The solution is -K^-1 coupling h.
    problem.coupling = -model_.coupling;
    SparseMatrix().swap(model_.coupling);
  } else {
    problem.coupling = transposed_rows(model_.space.values, model_.held);
    problem.hold = exact() ? Hold::multipliers : Hold::soft;
    problem.weights = Eigen::VectorXd::Constant(static_cast<Eigen::Index>(model_.held.size()),
                                                exact() ? multiplier_weight(problem.energy, problem.coupling) : 0.0);
    for (std::size_t j = 0; j < model_.held.size() && !exact(); ++j) {
      const RegionIndex region = region_of_[model_.held[j]];
      const std::size_t count = region == fixed_region ? regions_.fixed.size() : regions_.handles[region].size();
      problem.weights[static_cast<Eigen::Index>(j)] = options_.fixing / static_cast<double>(count);
    }
  }
  const std::size_t used = sparse_bytes(model_.space.values) + sparse_bytes(problem.energy) + sparse_bytes(problem.coupling);
  const std::size_t limit = memory_budget == 0 ? 0 : std::max<std::size_t>(1, memory_budget - std::min(memory_budget, used));
  solver_ = std::make_unique<const EnergySolver>(std::move(problem), limit, context);
  if (!exact() || model_.eliminated || model_.held.empty()) return;
  correction_ = std::make_unique<const ResidualCorrection>(unit_places(model_.held),
                                                           ResidualCorrection::centres_for(following_.size()), context);
  following_places_ = TiledPoints(unit_places(following_));
}

void EnergySystem::prepare_constraints(ConstraintSets constraints, const RunContext& context, std::size_t memory_budget) {
  if (constraints.sets.empty()) return;
  constraint_of_ = std::move(constraints.constraint_of);
  model_.space.notes.insert(model_.space.notes.end(), constraints.notes.begin(), constraints.notes.end());
  const std::size_t limit =
      memory_budget == 0 ? 0 : std::max<std::size_t>(1, memory_budget - std::min(memory_budget, solver_->bytes()));
  ConstrainedSolver::Options options;
  options.tolerance = setup_.constraint_options.tolerance;
  options.most_iterations = setup_.constraint_options.iterations;
  constrained_ = std::make_unique<const ConstrainedSolver>(*solver_, model_.space.values, std::move(constraints.sets), options,
                                                           limit, context);
  prepare_exact(constrained_->sets(), context);
  if (!correction_ && !placement_) return;
  std::vector<Vec3> places;
  for (const ConstraintSet& set : constrained_->sets()) places.insert(places.end(), set.rest.begin(), set.rest.end());
  set_places_ = TiledPoints(places);
}

std::vector<Vec3> EnergySystem::unit_places(const std::vector<PointId>& ids) const {
  std::vector<Vec3> places;
  places.reserve(ids.size());
  for (const PointId id : ids) places.push_back(box_.to_unit(mesh_->points[id]));
  return places;
}

Eigen::MatrixXd EnergySystem::misfit(const Eigen::MatrixXd& h, const Eigen::MatrixXd& w) const {
  return h - solver_->problem().coupling.transpose() * w;
}

EnergySystem::Solution EnergySystem::solve(const Eigen::MatrixXd& h, const RunContext& context) const {
  return completed(h, solver_->solve(h, context), context);
}

/// With what the functions leave of h.
EnergySystem::Solution EnergySystem::completed(const Eigen::MatrixXd& h, const Eigen::MatrixXd& w,
                                               const RunContext& context) const {
  Solution solution;
  solution.w = w;
  solution.misfits.assign(static_cast<std::size_t>(h.cols()), 0.0);
  if (model_.eliminated) return solution;
  if (correction_) solution.correction = correction_->coefficients(misfit(h, w), context);
  measure(h, solution);
  return solution;
}

void EnergySystem::measure(const Eigen::MatrixXd& h, Solution& solution) const {
  const std::size_t count = std::min(most_samples, model_.held.size());
  std::vector<Vec3> places(count);
  std::vector<std::size_t> which(count);
  for (std::size_t s = 0; s < count; ++s) {
    which[s] = s * model_.held.size() / count;
    places[s] = box_.to_unit(mesh_->points[model_.held[which[s]]]);
  }
  const TiledPoints tiled(places);
  const auto columns = static_cast<std::size_t>(h.cols());
  std::vector<double> values(columns * tile_size);
  for (std::size_t t = 0; t < tiled.tiles(); ++t) {
    std::fill(values.begin(), values.end(), 0.0);
    if (correction_) correction_->add_values(tiled.tile(t), solution.correction.data(), columns, values.data());
    for (std::size_t s = t * tile_size; s < std::min((t + 1) * tile_size, count); ++s) {
      for (std::size_t c = 0; c < columns; ++c) {
        double value = values[c * tile_size + s % tile_size];
        for (SparseRows::InnerIterator it(model_.space.values, model_.held[which[s]]); it; ++it) {
          value += it.value() * solution.w(it.col(), static_cast<Eigen::Index>(c));
        }
        const double target = h(static_cast<Eigen::Index>(which[s]), static_cast<Eigen::Index>(c));
        solution.misfits[c] = std::max(solution.misfits[c], std::abs(value - target));
      }
    }
  }
}

void EnergySystem::fill_tile(const Solution& solution, std::size_t tile, double* out) const {
  const auto columns = static_cast<std::size_t>(solution.w.cols());
  std::fill_n(out, columns * tile_size, 0.0);
  if (solution.correction.size() > 0) {
    correction_->add_values(following_places_.tile(tile), solution.correction.data(), columns, out);
  }
  if (solution.placement.size() > 0) {
    placement_correction_->add_values(following_places_.tile(tile), solution.placement.data(), columns, out);
  }
  const std::size_t end = std::min((tile + 1) * tile_size, following_.size());
  for (std::size_t s = tile * tile_size; s < end; ++s) {
    for (SparseRows::InnerIterator it(model_.space.values, following_[s]); it; ++it) {
      const double* w = solution.w.data() + static_cast<std::size_t>(it.col()) * columns;
      for (std::size_t c = 0; c < columns; ++c) out[c * tile_size + s % tile_size] += it.value() * w[c];
    }
  }
}

Eigen::MatrixXd EnergySystem::handle_fields(std::size_t handle) const {
  Eigen::MatrixXd fields = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(model_.held.size()), 4);
  for (std::size_t j = 0; j < model_.held.size(); ++j) {
    if (region_of_[model_.held[j]] != handle) continue;
    const Vec3 x = box_.to_unit(mesh_->points[model_.held[j]]);
    const auto row = static_cast<Eigen::Index>(j);
    fields(row, 0) = 1;
    for (int k = 0; k < 3; ++k) fields(row, 1 + k) = x[k] - frames_[handle].reference[k];
  }
  return fields;
}

/// A handle at a time: its four fields share the solution's memory.
void EnergySystem::prepare_basis(const RunContext& context, std::size_t memory_budget) {
  const std::size_t fields = 4 * frames_.size();
  const std::size_t bytes = FieldTiles::bytes_for(following_.size(), fields);
  if (!setup_.constraints.empty() || !wants_basis(options_.basis, bytes, solver_->bytes())) return;
  if (memory_budget != 0 && options_.basis == BasisMode::automatic && solver_->bytes() + bytes > memory_budget) return;
  auto basis = std::make_unique<FieldTiles>(following_.size(), fields);
  for (std::size_t h = 0; h < frames_.size(); ++h) {
    const Solution solution = solve(handle_fields(h), context);
    basis_misfits_.insert(basis_misfits_.end(), solution.misfits.begin(), solution.misfits.end());
    parallel_for(context, tile_count(following_.size()), tiles_per_task, [&](std::size_t begin, std::size_t end) {
      for (std::size_t t = begin; t < end; ++t) fill_tile(solution, t, basis->tile(t) + 4 * h * tile_size);
    });
    context.progress("basis", static_cast<double>(h + 1) / static_cast<double>(frames_.size()));
  }
  basis_ = std::move(basis);
}

void EnergySystem::fill_info() {
  info_.points = mesh_->point_count();
  info_.fixed_points = regions_.fixed.size();
  for (const auto& handle : regions_.handles) info_.handle_points += handle.size();
  info_.centres = model_.eliminated ? model_.held.size() : model_.space.samples;
  info_.functions = solver_->unknowns();
  info_.cubature_points = model_.space.cubature_points;
  info_.reduced = model_.eliminated && model_.held.size() < info_.constraint_points;
  info_.condition = 1 / std::max(solver_->factor().reciprocal_condition(), 1e-300);
  info_.factor_bytes = solver_->bytes() + (constrained_ ? constrained_->bytes() : 0) + (correction_ ? correction_->bytes() : 0) +
                       following_places_.bytes() + set_places_.bytes() +
                       (placement_ ? placement_->bytes() + placement_correction_->bytes() + exact_places_.bytes() : 0);
  info_.design_bytes = constrained_ ? constrained_->working_bytes() : 0;
  info_.basis_fields = basis_ ? basis_->fields() : 0;
  info_.basis_bytes = basis_ ? basis_->bytes() : 0;
  info_.bytes = info_.factor_bytes + info_.basis_bytes + sparse_bytes(model_.space.values) +
                point_bytes(mesh_->point_count(), regions_.symmetry);
  info_.notes = model_.space.notes;
  if (info_.reduced) {
    info_.notes.push_back(std::to_string(model_.held.size()) + " of " + std::to_string(info_.constraint_points) +
                          " constraint points enter the system: those within two rings of the deformable region.");
  }
  if (info_.condition > 1e13) info_.notes.push_back("The system is ill-conditioned: expect a loss of digits.");
  if (!basis_ && setup_.constraints.empty()) {
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

}  // namespace deform
