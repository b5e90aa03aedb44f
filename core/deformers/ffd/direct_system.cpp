// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/ffd/direct_system.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/ffd/damped_inverse.h"
#include "core/deformers/ffd/direct_evaluation.h"
#include "core/deformers/ffd/typical_fields.h"
#include "core/numerics/interpolation/point_errors.h"

namespace deform {

namespace {

constexpr std::size_t tiles_per_task = 64;
constexpr double decomposition_rate = 5e9;  // flops per second of a decomposition on one core
constexpr double sum_rounding = 2;          // of the sum over the functions at a point, times epsilon
constexpr double data_rounding = 0.1;       // of the sums that prescribed displacements are, over that of their largest terms
constexpr double epsilon = std::numeric_limits<double>::epsilon();

}  // namespace

DirectSystem::DirectSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const MakeDirectModel& make,
                           const RunContext& context, std::size_t memory_budget)
    : HandleSystem(std::move(mesh), setup, HandleMode::soft, Unit::diagonal, context) {
  // They go to one place in between, as least squares have it.
  points_.coincident.clear();
  for (std::size_t i = 0; i < points_.region_of.size(); ++i) {
    if (points_.region_of[i] != deformable_region) ids_.push_back(static_cast<PointId>(i));
  }
  end_stage("select");
  context.progress("assemble", 0);
  model_ = make(points_.region_of);
  end_stage("assemble");
  context.progress("factor", 0);
  const Eigen::MatrixXd fields = fields_at_held();
  checked_ = checked_rows(*model_.rows, checked_points(), setup_.images.get());
  std::vector<SparseRows> kinds(checked_.kinds.size());
  kinds.swap(checked_.kinds);
  const HeldInverse::Options options{model_.clamp,
                                     {typical_fields({*mesh_, setup_, points_.region_of, ids_, frames_, box_}), waves_at_held()},
                                     {std::move(kinds), model_.rounding}};
  if (reached_functions(*model_.rows, ids_).size() <= ClampedInverse::most_functions) {
    inverse_ = std::make_unique<const ClampedInverse>(*model_.rows, ids_, options, context);
  } else {
    inverse_ = std::make_unique<const DampedInverse>(*model_.rows, ids_, options, context);
  }
  HeldInverse::Solution solution = inverse_->solution(fields);
  controls_ = solution.coefficients;
  parts_ = std::move(solution.parts);
  end_stage("factor");
  prepare_basis(memory_budget, context);
  end_stage("basis");
  fill_info();
}

std::vector<PointId> DirectSystem::checked_points() const {
  // The points of the model itself, without its images: all follow.
  std::vector<PointId> points(setup_.images ? setup_.images->points() : mesh_->point_count());
  std::iota(points.begin(), points.end(), PointId{0});
  std::vector<PointId> result;
  for (const std::uint32_t i :
       check_points(unit_places(*mesh_, box_, points), unit_places(*mesh_, box_, ids_), HeldInverse::most_checked)) {
    result.push_back(points[i]);
  }
  return result;
}

Eigen::MatrixXd DirectSystem::fields_at_held() const {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(ids_.size()), static_cast<Eigen::Index>(fields()));
  for (std::size_t j = 0; j < ids_.size(); ++j) {
    const RegionIndex region = points_.region_of[ids_[j]];
    if (region == fixed_region) continue;
    const std::array<double, 4> values = handle_fields(region, ids_[j]);
    for (std::size_t f = 0; f < 4; ++f)
      result(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(4 * region + f)) = values[f];
  }
  return result;
}

Eigen::MatrixXd DirectSystem::waves_at_held() const {
  const std::vector<Vec3> places = unit_places(*mesh_, box_, ids_);
  const Box box = bounding_box(places);
  const double length = places.empty() ? 0 : box.side(box.longest_axis());
  if (length == 0) return {};
  constexpr double turn = 6.283185307179586;
  Eigen::MatrixXd result(static_cast<Eigen::Index>(places.size()), 6);
  for (std::size_t j = 0; j < places.size(); ++j) {
    for (std::size_t k = 0; k < 3; ++k) {
      const double phase = turn * (places[j][k] - box.min[k]) / length;
      result(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(2 * k)) = std::sin(phase);
      result(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(2 * k + 1)) = std::cos(phase);
    }
  }
  return result;
}

Eigen::MatrixXd DirectSystem::prescribed(const BoundDesign& design, MotionKind kind) const {
  const HeldPoints points = held();
  Eigen::MatrixXd result(static_cast<Eigen::Index>(ids_.size()), 3);
  for (std::size_t j = 0; j < ids_.size(); ++j) {
    const Vec3 u = points.displacement(design, ids_[j], kind);
    for (std::size_t k = 0; k < 3; ++k) result(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) = u[k];
  }
  return result;
}

Eigen::MatrixXd DirectSystem::affine_coefficients(const BoundDesign& design, MotionKind kind) const {
  Eigen::MatrixXd coefficients(static_cast<Eigen::Index>(fields()), 3);
  double block[12];
  for (std::size_t h = 0; h < frames_.size(); ++h) {
    field_coefficients(design.affine[h], kind, frames_[h], box_, block);
    for (std::size_t f = 0; f < 4; ++f) {
      for (std::size_t k = 0; k < 3; ++k) {
        coefficients(static_cast<Eigen::Index>(4 * h + f), static_cast<Eigen::Index>(k)) = block[3 * f + k];
      }
    }
  }
  return coefficients;
}

Eigen::MatrixXd DirectSystem::misfit(const Eigen::MatrixXd& h, const Eigen::MatrixXd& controls) const {
  Eigen::MatrixXd result = h;
  for (std::size_t j = 0; j < ids_.size(); ++j) {
    model_.rows->for_each(ids_[j], [&](std::int64_t column, double value) {
      result.row(static_cast<Eigen::Index>(j)) -= value * controls.row(column);
    });
  }
  return result;
}

HeldInverse::Sizes DirectSystem::sizes_of(const Solved& solved, Eigen::Index c) const {
  return {solved.controls.col(c).norm(), solved.missed.col(c).norm(), data_rounding * epsilon * solved.largest_terms};
}

double DirectSystem::field_error(const Solved& solved, Eigen::Index c) const {
  double largest = 0;
  for (std::size_t kind = 0; kind < checked_.kinds.size(); ++kind) {
    largest = std::max(largest, largest_magnitude(inverse_->uncertainty(kind, solved.parts.col(c), sizes_of(solved, c))));
  }
  return largest + sum_rounding * epsilon * model_.growth * solved.controls.col(c).cwiseAbs().maxCoeff();
}

double DirectSystem::error_of(const Solved& solved) const {
  Eigen::Matrix3d frame;
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t l = 0; l < 3; ++l) frame(static_cast<Eigen::Index>(l), static_cast<Eigen::Index>(k)) = checked_.axes[k][l];
  }
  const Solved turned{solved.controls * frame, solved.missed * frame, solved.parts * frame, solved.largest_terms};
  Eigen::MatrixXd errors(static_cast<Eigen::Index>(checked_.points), 3);
  for (std::size_t k = 0; k < 3; ++k) {
    auto error = errors.col(static_cast<Eigen::Index>(k));
    error.setZero();
    for (const CheckedRows::Term& term : checked_.terms[k]) {
      const auto c = static_cast<Eigen::Index>(term.component);
      error += inverse_->uncertainty(term.kind, turned.parts.col(c), sizes_of(turned, c));
    }
  }
  const double sums = sum_rounding * epsilon * model_.growth * solved.controls.rowwise().norm().maxCoeff();
  return largest_magnitude(errors.rowwise().norm()) + sums;
}

void DirectSystem::fill_tile(const RowMajor& controls, std::size_t tile, double* out) const {
  const auto columns = static_cast<std::size_t>(controls.cols());
  std::fill_n(out, columns * tile_size, 0.0);
  const std::size_t end = std::min((tile + 1) * tile_size, following().size());
  for (std::size_t s = tile * tile_size; s < end; ++s) {
    model_.rows->for_each(following()[s], [&](std::int64_t column, double value) {
      const double* w = controls.data() + static_cast<std::size_t>(column) * columns;
      for (std::size_t c = 0; c < columns; ++c) out[c * tile_size + s % tile_size] += value * w[c];
    });
  }
}

void DirectSystem::displace_tile(const RowMajor& controls, std::size_t tile, double* out) const {
  const std::size_t begin = tile * tile_size, count = std::min(tile_size, following().size() - begin);
  std::array<Vec3, tile_size> sums;
  const auto* const vectors = reinterpret_cast<const Vec3*>(controls.data());
  model_.rows->sums(std::span(following()).subspan(begin, count), {&vectors, 1}, sums.data());
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < tile_size; ++i) out[k * tile_size + i] = i < count ? sums[i][k] : 0.0;
  }
}

void DirectSystem::prepare_basis(std::size_t memory_budget, const RunContext& context) {
  const std::size_t bytes = HandleBasis::bytes_for(following().size(), fields(), model_.basis_tolerance);
  if (!wants_basis(model_.basis, bytes, inverse_->bytes())) return;
  const std::size_t making = HandleBasis::peak_bytes_for(following().size(), fields(), model_.basis_tolerance);
  if (memory_budget != 0 && model_.basis == BasisMode::automatic && inverse_->bytes() + making > memory_budget) return;
  HandleBasis basis{{0, 1, 2}, FieldTiles(following().size(), HandleSystem::fields()), {}};
  missed_ = misfit(fields_at_held(), controls_);
  const Solved fields{controls_, missed_, parts_, 1};
  for (Eigen::Index f = 0; f < controls_.cols(); ++f) {
    basis.residuals.push_back(missed_.col(f).cwiseAbs().maxCoeff());
    basis.more.push_back(field_error(fields, f));
  }
  parallel_for(context, tile_count(following().size()), tiles_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) fill_tile(controls_, t, basis.tiles.tile(t));
  });
  add_basis(std::move(basis), model_.basis_tolerance, context);
}

void DirectSystem::fill_info() {
  info_.solver = Solver::automatic;  // the pseudo-inverse
  info_.samples = info_.functions = static_cast<std::size_t>(model_.rows->cols());
  info_.condition = inverse_->condition();
  set_bytes(inverse_->bytes() + static_cast<std::size_t>(controls_.size() + missed_.size() + parts_.size()) * sizeof(double),
            model_.rows->bytes() + ids_.size() * sizeof(PointId) + following().size() * sizeof(PointId));
  info_.notes = model_.notes;
  const Eigen::MatrixXd missed = has_basis() ? missed_ : misfit(fields_at_held(), controls_);
  info_.notes.push_back(inverse_->note());
  double misfit = 0, motion = 0;  // of handles that are shifted
  for (std::size_t h = 0; h < frames_.size(); ++h) {
    const auto f = static_cast<Eigen::Index>(4 * h);
    misfit = std::max(misfit, missed.col(f).cwiseAbs().maxCoeff());
    motion = std::max(motion, controls_.col(f).cwiseAbs().maxCoeff());
  }
  info_.notes.push_back("Where one handle is shifted, handle and fixed points are off by up to " + scientific(misfit) +
                        " of that, and control points move by up to " + scientific(motion) + " of it.");
  if (!has_basis()) info_.notes.push_back("No handle basis is stored: every design is solved for.");
}

std::unique_ptr<const Evaluation> DirectSystem::bind(std::span<const Design> designs, EvaluationPath path,
                                                     const RunContext& context) const {
  return std::make_unique<DirectEvaluation>(std::static_pointer_cast<const DirectSystem>(shared_from_this()), designs, path,
                                            context);
}

std::unique_ptr<const Evaluation> DirectSystem::derivative(std::span<const double>, const std::vector<Affine>& maps,
                                                           const RunContext& context) const {
  return std::make_unique<DirectEvaluation>(std::static_pointer_cast<const DirectSystem>(shared_from_this()), maps, context);
}

HandleSystem::Fields DirectSystem::adjoint(std::span<const double>, Cotangents at_following, const RunContext& context) const {
  context.check();
  const auto columns = static_cast<Eigen::Index>(3 * at_following.size());
  Eigen::MatrixXd g = Eigen::MatrixXd::Zero(model_.rows->cols(), columns);
  for (std::size_t s = 0; s < following().size(); ++s) {
    model_.rows->for_each(following()[s], [&](std::int64_t column, double value) {
      for (Eigen::Index k = 0; k < columns; ++k) {
        g(column, k) += value * at_following[static_cast<std::size_t>(k) / 3][s][static_cast<std::size_t>(k) % 3];
      }
    });
  }
  const Eigen::MatrixXd G = fields_at_held().transpose() * inverse_->adjoint(g);
  Fields result(at_following.size());
  for (Eigen::Index f = 0; f < G.rows(); ++f) {
    for (Eigen::Index k = 0; k < columns; ++k) result[static_cast<std::size_t>(k) / 3].push_back(G(f, k));
  }
  return result;
}

Estimate estimate_direct(const Mesh& mesh, const SelectedRegions& regions, const DirectEstimate& of) {
  const std::size_t n = mesh.point_count(), k = of.functions, fields = 4 * regions.handles.size();
  Estimate estimate;
  estimate.constraint_points = of.held;
  estimate.samples = k;
  estimate.factor_bytes = of.inverse.resident + 2 * k * fields * sizeof(double);
  const std::size_t basis_bytes = HandleBasis::bytes_for(n, fields, of.basis_tolerance);
  const bool basis = wants_basis(of.basis, basis_bytes, estimate.factor_bytes);
  estimate.basis_bytes = basis ? basis_bytes + fields * sizeof(double) : 0;
  const std::size_t missed_bytes = basis ? of.held * fields * sizeof(double) : 0;
  const std::size_t own = missed_bytes + point_bytes(n, regions.symmetry) + of.row_bytes + (of.held + n) * sizeof(PointId);
  estimate.resident_bytes = estimate.factor_bytes + estimate.basis_bytes + own;
  const std::size_t making = basis ? HandleBasis::peak_bytes_for(n, fields, of.basis_tolerance) : 0;
  // Fields, their misfits and copies of them; waves for the automatic clamp.
  const std::size_t data = (4 * fields + 12) * of.held * sizeof(double) + (3 * fields + 12) * k * sizeof(double);
  estimate.peak_bytes = own + data + std::max(of.inverse.resident + of.inverse.peak, estimate.factor_bytes + making);
  const double rows = static_cast<double>(n) * of.seconds_per_row;
  estimate.seconds =
      of.inverse.flops / decomposition_rate + (static_cast<double>(n * (fields + 8)) * 1e-7 + rows) / thread_count({});
  if (!basis) estimate.notes.emplace_back("No handle basis will be stored: every design is solved for.");
  return estimate;
}

}  // namespace deform
