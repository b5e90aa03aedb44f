// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/rbf/rbf_system.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/deformers/rbf/interpolated_basis.h"
#include "core/deformers/rbf/rbf_evaluation.h"

namespace deform {

namespace {

int degree(const RbfOptions& options) {
  return options.polynomial_degree >= 0 ? options.polynomial_degree : properties(options.kernel).default_degree();
}

/// Median distance to the nearest other place, over an evenly strided sample of the first `count` places.
double median_spacing(const std::vector<Vec3>& places, std::size_t count) {
  constexpr std::size_t sample = 500;
  const std::size_t stride = count / sample + 1;
  std::vector<double> nearest;
  for (std::size_t i = 0; i < count; i += stride) {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < places.size(); ++j) {
      if (j != i) least = std::min(least, distance(places[i], places[j]));
    }
    nearest.push_back(least);
  }
  const auto middle = nearest.begin() + static_cast<std::ptrdiff_t>(nearest.size() / 2);
  std::nth_element(nearest.begin(), middle, nearest.end());
  return *middle;
}

}  // namespace

RbfSystem::RbfSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RbfOptions& options, const RunContext& context,
                     std::size_t memory_budget)
    : HandleSystem(std::move(mesh), setup, HandleMode::hard, Unit::longest_edge, context), options_(options) {
  centres_ = choose_centres(*mesh_, points_, regions_.handles.size(), options_);
  deformable_ = TiledPoints(coordinates(following()));
  end_stage("select");
  context.check();
  prepare_parts(context, memory_budget);
  end_stage("factor");
  prepare_basis(context);
  end_stage("basis");
  fill_info();
  add_notes();
}

std::vector<Vec3> RbfSystem::coordinates(const std::vector<PointId>& ids) const {
  if (regions_.symmetry.empty()) return unit_places(*mesh_, box_, ids);
  std::vector<Vec3> result;
  result.reserve(ids.size());
  for (const PointId id : ids) {
    const Vec3 y = regions_.symmetry.coordinates(mesh_->points[id]);
    result.push_back(y / box_.scale);
  }
  return result;
}

/// Of the centres and their images together: the shape is that of the whole model.
InterpolationOptions RbfSystem::interpolation_options(const std::vector<Vec3>& places) {
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
  interpolation.kernel = {options_.kernel, options_.shape * size};
  if (options_.shape == 0) {
    interpolation.kernel.shape = automatic_shape(options_.kernel, median_spacing(all, places.size()), size);
  }
  interpolation.polynomial_degree = degree(options_);
  relative_shape_ = interpolation.kernel.shape / size;
  const bool iterative = chosen_solver(options_.solver, options_.kernel, places.size()) == Solver::iterative;
  interpolation.solver = iterative ? Solver::iterative : options_.solver;
  return interpolation;
}

void RbfSystem::prepare_parts(const RunContext& context, std::size_t memory_budget) {
  const std::vector<Vec3> places = coordinates(centres_.ids);
  InterpolationOptions interpolation = interpolation_options(places);
  std::size_t& used = factor_bytes_;
  for (PartPlan& plan : plan_parts(regions_.symmetry, centres_, interpolation.solver)) {
    RbfPart part{std::move(plan), nullptr};
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
}

Eigen::MatrixXd RbfSystem::fields_at_centres() const {
  Eigen::MatrixXd result =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(centres_.ids.size()), static_cast<Eigen::Index>(fields()));
  for (std::size_t j = 0; j < centres_.ids.size(); ++j) {
    const RegionIndex region = points_.region_of[centres_.ids[j]];
    if (region == fixed_region) continue;
    const std::array<double, 4> values = handle_fields(region, centres_.ids[j]);
    for (std::size_t f = 0; f < 4; ++f) {
      result(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(4 * region + f)) = values[f];
    }
  }
  return result;
}

Eigen::MatrixXd RbfSystem::sample_fields() const {
  const auto& samples = options_.samples;
  Eigen::MatrixXd fields =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(centres_.ids.size()), static_cast<Eigen::Index>(3 * samples.size()));
  for (std::size_t s = 0; s < samples.size(); ++s) {
    const std::vector<Affine> motions = handle_motions(setup_, samples[s]);
    for (std::size_t j = 0; j < centres_.ids.size(); ++j) {
      const PointId id = centres_.ids[j];
      const RegionIndex region = points_.region_of[id];
      if (region == fixed_region) continue;
      const Vec3& x = mesh_->points[id];
      Vec3 u = transformed(motions[region], x) - x;
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
  interpolation.sample_tolerance = options_.tolerance;
  interpolation.order = options_.centre_order;
  if (options_.samples.empty()) {
    interpolation.samples = plan.data(fields_at_centres());
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
  std::size_t factor_bytes = 0;
  const Interpolator* last = nullptr;
  for (const RbfPart& part : parts_) {
    if (part.system.get() != last) factor_bytes += interpolator_bytes(part.system->size(), part.system->solver());
    last = part.system.get();
  }
  if (!wants_basis(options_.basis, parts_.size() * HandleBasis::bytes_for(deformable_.count(), fields()), factor_bytes)) return;
  for (const RbfPart& part : parts_) {
    basis_.push_back(interpolated_basis(part.plan.components, *part.system, part.plan.data(fields_at_centres()), deformable_,
                                        options_.tolerance, context));
  }
}

void RbfSystem::fill_info() {
  info_.centres = centres_.ids.size();
  info_.merged_duplicates = centres_.merged;
  info_.affine_hull_dimension = 0;
  std::size_t weighted = 0;  // of incremental QR, the most of any part
  for (const RbfPart& part : parts_) {
    const bool shared = &part != &parts_.front() && part.system == parts_.front().system;
    if (!shared) info_.polynomial_terms += part.system->polynomials().terms();
    info_.affine_hull_dimension = std::max(info_.affine_hull_dimension, part.system->polynomials().hull_dimension());
    info_.condition = std::max(info_.condition, part.system->condition());
    if (part.system->solver() == Solver::incremental_qr) weighted = std::max(weighted, part.system->weighted());
  }
  if (weighted > 0) info_.centres = weighted;
  // Of several parts the one that fell back to another solver.
  if (!parts_.empty()) info_.solver = parts_.front().system->solver();
  for (const RbfPart& part : parts_) {
    if (part.system->solver() == Solver::ldlt) info_.solver = Solver::ldlt;
  }
  info_.tolerance = to_tolerance(info_.solver) ? options_.tolerance : 0;
  info_.reduced = centres_.reduced;
  set_bytes(factor_bytes_, 0);
}

void RbfSystem::add_notes() {
  info_.notes = centres_.notes;
  const auto symmetry_notes = deform::symmetry_notes(regions_.symmetry, centres_);
  info_.notes.insert(info_.notes.end(), symmetry_notes.begin(), symmetry_notes.end());
  std::size_t dropped = 0;
  bool converged = true;
  double residual = 0;
  const Interpolator* last = nullptr;
  for (const HandleBasis& basis : basis_) {
    converged = converged && basis.converged;
    residual = std::max(residual, *std::max_element(basis.residuals.begin(), basis.residuals.end()));
  }
  for (const RbfPart& part : parts_) {
    if (part.system.get() == last) continue;
    last = part.system.get();
    dropped += last->polynomials().dropped();
    const auto& solver_notes = last->notes();
    info_.notes.insert(info_.notes.end(), solver_notes.begin(), solver_notes.end());
  }
  static const char* const hulls[] = {"in one point", "on a line", "in a plane"};
  if (degree(options_) > 0 && info_.affine_hull_dimension < 3) {
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
  if (properties(options_.kernel).has_shape && options_.shape == 0) {
    info_.notes.push_back("The shape is " + number_digits(relative_shape_) + " of the diagonal of the centres (automatic).");
  }
}

std::unique_ptr<const Evaluation> RbfSystem::bind(std::span<const Design> designs, EvaluationPath path,
                                                  const RunContext& context) const {
  return std::make_unique<RbfEvaluation>(std::static_pointer_cast<const RbfSystem>(shared_from_this()), designs, path, context);
}

std::unique_ptr<const Evaluation> RbfSystem::derivative(std::span<const double>, const std::vector<Affine>& maps,
                                                        const RunContext& context) const {
  return std::make_unique<RbfEvaluation>(std::static_pointer_cast<const RbfSystem>(shared_from_this()), maps, context);
}

/// Transpose of "fields of the handles to deformable points" for one part: 4H x 3, of which the columns of its components count.
Eigen::MatrixXd RbfSystem::adjoint(const RbfPart& part, std::span<const Vec3> at_deformable, const RunContext& context) const {
  // u = [Phi P] S [fields; 0] with the symmetric S, so the adjoint is fields^T times the first rows of S [Phi^T; P^T].
  const std::vector<Vec3> unit = coordinates(following());
  const std::size_t m = part.system->size();
  const auto q = static_cast<Eigen::Index>(part.system->polynomials().terms());
  const std::span<const double> weights(unit.empty() ? nullptr : at_deformable[0].data(), 3 * unit.size());
  const std::vector<double> sums = part.system->sums_at_centres(unit, weights, 3, context);
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(m) + q, 3);
  for (std::size_t j = 0; j < m; ++j) {
    for (int k = 0; k < 3; ++k) B(static_cast<Eigen::Index>(j), k) = sums[3 * j + static_cast<std::size_t>(k)];
  }
  std::vector<double> terms(static_cast<std::size_t>(q));
  for (std::size_t i = 0; i < unit.size(); ++i) {
    part.system->polynomials().values(unit[i], terms.data());
    for (Eigen::Index t = 0; t < q; ++t) {
      for (int k = 0; k < 3; ++k)
        B(static_cast<Eigen::Index>(m) + t, k) += terms[static_cast<std::size_t>(t)] * at_deformable[i][k];
    }
  }
  return part.plan.data(fields_at_centres()).transpose() * part.system->adjoint(std::move(B), context);
}

std::vector<double> RbfSystem::adjoint(std::span<const double>, const std::vector<Vec3>& at_following,
                                       const RunContext& context) const {
  std::vector<double> result(3 * fields(), 0.0);
  for (const RbfPart& part : parts_) {
    const Eigen::MatrixXd G = adjoint(part, at_following, context);
    for (std::size_t f = 0; f < fields(); ++f) {
      for (const std::size_t k : part.plan.components) {
        result[3 * f + k] = G(static_cast<Eigen::Index>(f), static_cast<Eigen::Index>(k));
      }
    }
  }
  return result;
}

}  // namespace deform
