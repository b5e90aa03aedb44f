#include "core/deformers/rbf/rbf_system.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/stopwatch.h"
#include "core/deformers/rbf/rbf_evaluation.h"

namespace deform {

namespace {

UnitBox unit_box(const Box& box) {
  UnitBox unit{box.min, 0};
  for (int k = 0; k < 3; ++k) unit.scale = std::max(unit.scale, box.max[k] - box.min[k]);
  if (unit.scale <= 0) unit.scale = 1;
  return unit;
}

/// Median distance to the nearest other place, over an evenly strided sample of the first `count` places.
double median_spacing(const std::vector<Vec3>& places, std::size_t count) {
  constexpr std::size_t sample = 500;
  const std::size_t stride = count / sample + 1;
  std::vector<double> nearest;
  for (std::size_t i = 0; i < count; i += stride) {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < places.size(); ++j) {
      if (j != i)
        least =
            std::min(least, std::hypot(places[i][0] - places[j][0], places[i][1] - places[j][1], places[i][2] - places[j][2]));
    }
    nearest.push_back(least);
  }
  const auto middle = nearest.begin() + static_cast<std::ptrdiff_t>(nearest.size() / 2);
  std::nth_element(nearest.begin(), middle, nearest.end());
  return *middle;
}

}  // namespace

RbfSystem::RbfSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context, std::size_t memory_budget)
    : mesh_(std::move(mesh)), setup_(setup) {
  const auto& options = std::get<RbfOptions>(setup_.method);
  Stopwatch watch;
  context.progress("select", 0);
  regions_ = validate(setup_, *mesh_);
  polynomial_degree(options);
  const Box bounds = bounding_box(mesh_->points);
  box_ = unit_box(bounds);
  info_.diagonal = bounds.diagonal();
  centres_ = choose_centres(*mesh_, regions_, options);
  place_points();
  info_.stage_seconds.emplace_back("select", watch.lap());
  context.check();
  prepare_parts(context, memory_budget);
  info_.stage_seconds.emplace_back("factor", watch.lap());
  prepare_basis(context);
  info_.stage_seconds.emplace_back("basis", watch.lap());
  fill_info();
  add_notes();
}

Vec3 RbfSystem::coordinates(PointId id) const {
  const Vec3& x = mesh_->points[id];
  if (regions_.symmetry.empty()) return box_.to_unit(x);
  const Vec3 y = regions_.symmetry.coordinates(x);
  return {y[0] / box_.scale, y[1] / box_.scale, y[2] / box_.scale};
}

void RbfSystem::place_points() {
  rank_of_.assign(mesh_->point_count(), 0);
  for (const auto& handle : regions_.handles) {
    for (std::size_t k = 0; k < handle.size(); ++k) {
      rank_of_[handle[k]] = static_cast<std::uint32_t>(k);
      if (regions_.symmetry.on(handle[k]) != 0) sliding_.push_back(handle[k]);
    }
  }
  std::sort(sliding_.begin(), sliding_.end());
  std::vector<Vec3> unit;
  unit.reserve(centres_.deformable.size());
  for (const PointId id : centres_.deformable) unit.push_back(coordinates(id));
  deformable_ = TiledPoints(unit);
  frames_ = handle_frames(*mesh_, regions_, box_);
}

/// Of the centres and their images together: the shape is that of the whole model.
InterpolationOptions RbfSystem::interpolation_options(const std::vector<Vec3>& places) {
  const auto& options = std::get<RbfOptions>(setup_.method);
  const Symmetry& symmetry = regions_.symmetry;
  const unsigned images = 1u << symmetry.planes();
  Box extent;
  std::vector<Vec3> all = places;
  for (unsigned reflected = 0; reflected < images; ++reflected) {
    for (std::size_t j = 0; j < places.size(); ++j) {
      Vec3 x = mesh_->points[centres_.ids[j]], y = places[j];
      for (std::size_t k = 0; k < symmetry.planes(); ++k) {
        if ((reflected >> k & 1u) == 0) continue;
        x = symmetry.reflected(x, k);
        y[k] = -y[k];
      }
      extent.add(box_.to_unit(x));
      if (reflected != 0 && (reflected & symmetry.on(centres_.ids[j])) == 0) all.push_back(y);
    }
  }
  const double size = extent.diagonal() > 0 ? extent.diagonal() : 1.0;
  InterpolationOptions interpolation;
  interpolation.kernel = {options.kernel, options.shape * size};
  if (options.shape == 0) {
    interpolation.kernel.shape = automatic_shape(options.kernel, median_spacing(all, places.size()), size);
  }
  interpolation.polynomial_degree = polynomial_degree(options);
  relative_shape_ = interpolation.kernel.shape / size;
  const bool iterative = chosen_solver(options.solver, options.kernel, places.size()) == Solver::iterative;
  interpolation.solver = iterative ? Solver::iterative : options.solver;
  return interpolation;
}

void RbfSystem::prepare_parts(const RunContext& context, std::size_t memory_budget) {
  std::vector<Vec3> places;
  for (const PointId id : centres_.ids) places.push_back(coordinates(id));
  InterpolationOptions interpolation = interpolation_options(places);
  std::size_t used = 0;
  for (PartPlan& plan : plan_parts(regions_.symmetry, centres_, interpolation.solver)) {
    RbfPart part{std::move(plan), nullptr, nullptr};
    if (interpolation.solver == Solver::iterative && !parts_.empty()) {
      part.system = parts_.front().system;
    } else {
      interpolation.kernel.parity = part.plan.parity;
      if (interpolation.solver == Solver::incremental_qr) set_samples(interpolation, part.plan);
      interpolation.memory_limit =
          memory_budget == 0 ? 0 : std::max<std::size_t>(1, memory_budget - std::min(memory_budget, used));
      part.system = make_interpolator(part.plan.places(places), interpolation, context);
      used += part.system->bytes();
    }
    parts_.push_back(std::move(part));
  }
  info_.factor_bytes = used;
}

Eigen::MatrixXd RbfSystem::handle_fields() const {
  Eigen::MatrixXd fields =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(centres_.ids.size()), static_cast<Eigen::Index>(4 * frames_.size()));
  for (std::size_t j = 0; j < centres_.ids.size(); ++j) {
    const RegionIndex region = centres_.region_of[centres_.ids[j]];
    if (region == fixed_region) continue;
    const Vec3 x = box_.to_unit(mesh_->points[centres_.ids[j]]);
    const auto row = static_cast<Eigen::Index>(j);
    const auto column = static_cast<Eigen::Index>(4 * region);
    fields(row, column) = 1;
    for (int k = 0; k < 3; ++k) fields(row, column + 1 + k) = x[k] - frames_[region].reference[k];
  }
  return fields;
}

Eigen::MatrixXd RbfSystem::sample_fields() const {
  const auto& samples = std::get<RbfOptions>(setup_.method).samples;
  Eigen::MatrixXd fields =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(centres_.ids.size()), static_cast<Eigen::Index>(3 * samples.size()));
  for (std::size_t s = 0; s < samples.size(); ++s) {
    const std::vector<Affine> motions = handle_motions(setup_, samples[s]);
    for (std::size_t j = 0; j < centres_.ids.size(); ++j) {
      const PointId id = centres_.ids[j];
      const RegionIndex region = centres_.region_of[id];
      if (region == fixed_region) continue;
      const Vec3& x = mesh_->points[id];
      const Vec3 to = transformed(motions[region], x);
      Vec3 u{to[0] - x[0], to[1] - x[1], to[2] - x[2]};
      if (!regions_.symmetry.empty()) u = components(regions_.symmetry.to_frame(u), id);
      for (std::size_t k = 0; k < 3; ++k) {
        fields(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(3 * s + k)) = u[k] / info_.diagonal;
      }
    }
  }
  return fields;
}

/// What the centres of incremental QR are chosen for: the samples, or without any the fields that affine motions combine.
void RbfSystem::set_samples(InterpolationOptions& interpolation, const PartPlan& plan) const {
  const auto& options = std::get<RbfOptions>(setup_.method);
  interpolation.sample_tolerance = options.tolerance;
  interpolation.order = options.centre_order;
  if (options.samples.empty()) {
    interpolation.samples = plan.data(handle_fields());
    interpolation.columns_per_field = 4;
    return;
  }
  const Eigen::MatrixXd all = sample_fields();
  const auto width = static_cast<Eigen::Index>(plan.components.size());
  Eigen::MatrixXd chosen(all.rows(), all.cols() / 3 * width);
  for (Eigen::Index s = 0; s < all.cols() / 3; ++s) {
    for (Eigen::Index c = 0; c < width; ++c) {
      chosen.col(s * width + c) = all.col(3 * s + static_cast<Eigen::Index>(plan.components[static_cast<std::size_t>(c)]));
    }
  }
  interpolation.samples = plan.data(chosen);
  interpolation.columns_per_field = plan.components.size();
}

void RbfSystem::prepare_basis(const RunContext& context) {
  const auto& options = std::get<RbfOptions>(setup_.method);
  const std::size_t fields = 4 * frames_.size();
  std::size_t factor_bytes = 0;
  const Interpolator* last = nullptr;
  for (const RbfPart& part : parts_) {
    if (part.system.get() != last) factor_bytes += interpolator_bytes(part.system->size(), part.system->solver());
    last = part.system.get();
  }
  if (!wants_basis(options.basis, parts_.size() * HandleBasis::bytes_for(deformable_.count(), fields), factor_bytes)) return;
  for (RbfPart& part : parts_) {
    part.basis =
        std::make_unique<HandleBasis>(*part.system, part.plan.data(handle_fields()), deformable_, options.tolerance, context);
  }
}

void RbfSystem::fill_info() {
  const auto& options = std::get<RbfOptions>(setup_.method);
  info_.points = mesh_->point_count();
  info_.fixed_points = regions_.fixed.size();
  for (const auto& handle : regions_.handles) info_.handle_points += handle.size();
  info_.deformable_points = centres_.deformable.size();
  info_.constraint_points = centres_.constraint_points;
  info_.centres = centres_.ids.size();
  info_.merged_duplicates = centres_.merged;
  info_.affine_hull_dimension = 0;
  std::size_t weighted = 0;  // of incremental QR, the most of any part
  for (const RbfPart& part : parts_) {
    const bool shared = &part != &parts_.front() && part.system == parts_.front().system;
    if (!shared) info_.polynomial_terms += part.system->polynomials().terms();
    info_.affine_hull_dimension = std::max(info_.affine_hull_dimension, part.system->polynomials().hull_dimension());
    info_.condition = std::max(info_.condition, part.system->condition());
    if (part.basis) info_.basis_bytes += part.basis->bytes();
    if (part.system->solver() == Solver::incremental_qr) weighted = std::max(weighted, part.system->weighted());
  }
  if (weighted > 0) info_.centres = weighted;
  // Of several parts the one that fell back to another solver.
  if (!parts_.empty()) info_.solver = parts_.front().system->solver();
  for (const RbfPart& part : parts_) {
    if (part.system->solver() == Solver::ldlt) info_.solver = Solver::ldlt;
  }
  info_.tolerance = to_tolerance(info_.solver) ? options.tolerance : 0;
  info_.reduced = centres_.reduced;
  info_.basis_fields = has_basis() ? parts_.front().basis->fields() : 0;
  info_.bytes = info_.factor_bytes + info_.basis_bytes + point_bytes(mesh_->point_count(), regions_.symmetry);
}

void RbfSystem::add_notes() {
  const auto& options = std::get<RbfOptions>(setup_.method);
  info_.notes = centres_.notes;
  const auto symmetry_notes = deform::symmetry_notes(regions_.symmetry, centres_);
  info_.notes.insert(info_.notes.end(), symmetry_notes.begin(), symmetry_notes.end());
  std::size_t dropped = 0;
  bool converged = true;
  double residual = 0;
  const Interpolator* last = nullptr;
  for (const RbfPart& part : parts_) {
    if (part.basis) {
      converged = converged && part.basis->converged();
      residual = std::max(residual, *std::max_element(part.basis->residuals().begin(), part.basis->residuals().end()));
    }
    if (part.system.get() == last) continue;
    last = part.system.get();
    dropped += last->polynomials().dropped();
    const auto& solver_notes = last->notes();
    info_.notes.insert(info_.notes.end(), solver_notes.begin(), solver_notes.end());
  }
  static const char* const hulls[] = {"in one point", "on a line", "in a plane"};
  if (polynomial_degree(options) > 0 && info_.affine_hull_dimension < 3) {
    info_.notes.push_back(std::string("The centres lie ") + hulls[info_.affine_hull_dimension] +
                          ": the polynomial part is constant across it.");
  }
  if (dropped > 0) {
    info_.notes.push_back(std::to_string(dropped) + " monomials depend on the others at the centres and were left out.");
  }
  if (info_.solver == Solver::iterative) {
    info_.notes.push_back("The systems are solved iteratively, to " + scientific(info_.tolerance) + " of the diagonal.");
  }
  if (info_.solver == Solver::incremental_qr) {
    info_.notes.push_back("Least squares: " + std::to_string(info_.centres) + " of the " + std::to_string(centres_.ids.size()) +
                          " constraint points are centres, for an RMS error of " + scientific(info_.tolerance) +
                          " of the diagonal.");
  }
  if (to_tolerance(info_.solver) && has_basis() && !converged) {
    info_.notes.push_back("The solver did not reach its tolerance for the handle basis: the largest residual is " +
                          scientific(residual) + ".");
  }
  if (info_.condition > 1e13) info_.notes.push_back("The system is ill-conditioned: expect a loss of digits.");
  if (!has_basis()) info_.notes.push_back("No handle basis is stored: every design is solved for and summed directly.");
  if (properties(options.kernel).has_shape && options.shape == 0) {
    info_.notes.push_back("The shape is " + number_digits(relative_shape_) + " of the diagonal of the centres (automatic).");
  }
}

std::unique_ptr<const Evaluation> RbfSystem::bind(std::span<const Design> designs, EvaluationPath path,
                                                  const RunContext& context) const {
  return std::make_unique<RbfEvaluation>(std::static_pointer_cast<const RbfSystem>(shared_from_this()), designs, path, context);
}

}  // namespace deform
