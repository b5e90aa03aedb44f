// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/residual_correction.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/parallel.h"
#include "core/deformers/handles/interpolant_tiles.h"
#include "core/numerics/sampling/farthest_points.h"
#include "core/numerics/sampling/point_tree.h"

namespace deform {

namespace {

/// Wendland's C2 function of a distance over the radius, at most 1.
double wendland_c2(double q) {
  const double t = (1 - q) * (1 - q);
  return t * t * (4 * q + 1);
}

std::vector<Vec3> subset(std::span<const Vec3> places, const std::vector<std::uint32_t>& which) {
  std::vector<Vec3> result;
  result.reserve(which.size());
  for (const std::uint32_t i : which) result.push_back(places[i]);
  return result;
}

InterpolationOptions options_of(ResidualCorrection::Kind kind) {
  InterpolationOptions options;
  if (kind == ResidualCorrection::Kind::gentle) {
    options.kernel.kernel = Kernel::biharmonic;
    options.polynomial_degree = 0;
  }
  return options;
}

}  // namespace

Eigen::VectorXd ResidualCorrection::shares_of(std::span<const Vec3> places, const RunContext& context) {
  constexpr std::size_t places_per_task = 1024;
  Eigen::VectorXd result(static_cast<Eigen::Index>(places.size()));
  const PointTree tree(places);
  parallel_for(context, places.size(), places_per_task, [&](std::size_t begin, std::size_t end) {
    std::vector<PointTree::Near> found;
    for (std::size_t i = begin; i < end; ++i) {
      tree.within(places[i], near * near, found);
      double sum = 0;
      for (const auto& [other, square] : found) sum += wendland_c2(std::sqrt(square) / near);
      result[static_cast<Eigen::Index>(i)] = 1 / sum;
    }
  });
  return result;
}

std::size_t ResidualCorrection::centres_for(std::size_t points) {
  constexpr std::size_t evaluations = 120'000'000;
  return std::clamp<std::size_t>(evaluations / std::max<std::size_t>(1, points), 600, 2000);
}

std::vector<std::uint32_t> ResidualCorrection::centres_of(std::span<const Vec3> places, std::size_t most, Kind kind) {
  constexpr double alike = 1e-9;
  return farthest_point_order(places, most, alike, kind == Kind::smooth ? near : 0);
}

// In stored systems rounding decides which centres there are.
ResidualCorrection::ResidualCorrection(std::span<const Vec3> places, std::size_t most_centres, std::span<const char> bound,
                                       const RunContext& context)
    : ResidualCorrection(
          places, bound.empty() ? farthest_point_order(places, most_centres) : centres_of(places, most_centres, Kind::smooth),
          Kind::smooth, bound, context) {}

ResidualCorrection::ResidualCorrection(std::span<const Vec3> places, std::vector<std::uint32_t> centres, Kind kind,
                                       std::span<const char> bound, const RunContext& context)
    : held_(places.size()), centres_(std::move(centres)), system_(subset(places, centres_), options_of(kind), context) {
  if (bound.empty()) return;
  std::vector<CompactLevel> levels = choose_levels({places, centres_, bound}, context);
  if (levels.empty()) return;
  levels_ = std::make_unique<const CompactLevels>(places, std::move(levels), context);
  used_ = TiledPoints(levels_->used_places());
}

std::size_t ResidualCorrection::bytes() const { return system_.bytes() + (levels_ ? levels_->bytes() + used_.bytes() : 0); }

Eigen::MatrixXd ResidualCorrection::smooth_coefficients(const Eigen::MatrixXd& misfit, const RunContext& context) const {
  Eigen::MatrixXd values(static_cast<Eigen::Index>(centres_.size()), misfit.cols());
  for (std::size_t j = 0; j < centres_.size(); ++j) {
    values.row(static_cast<Eigen::Index>(j)) = misfit.row(static_cast<Eigen::Index>(centres_[j]));
  }
  // Column by column: BLAS sums in another order for another number of columns.
  const auto smooth = static_cast<Eigen::Index>(smooth_rows());
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(rows()), misfit.cols());
  for (Eigen::Index c = 0; c < misfit.cols(); ++c) {
    result.col(c).head(smooth) = system_.interpolate(values.col(c), 0, context).coefficients;
  }
  return result;
}

Eigen::MatrixXd ResidualCorrection::coefficients(const Eigen::MatrixXd& misfit, const RunContext& context) const {
  Eigen::MatrixXd result = smooth_coefficients(misfit, context);
  if (!levels_) return result;
  const auto smooth = static_cast<Eigen::Index>(smooth_rows());
  result.bottomRows(result.rows() - smooth) = levels_->coefficients(left(misfit, result.topRows(smooth), context), context);
  return result;
}

/// What the smooth interpolant leaves at the points of the levels.
Eigen::MatrixXd ResidualCorrection::left(const Eigen::MatrixXd& misfit, const Eigen::MatrixXd& smooth,
                                         const RunContext& context) const {
  constexpr std::size_t tiles_per_task = 16;
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> coefficients = smooth;
  const auto columns = static_cast<std::size_t>(misfit.cols());
  const std::vector<std::uint32_t>& used = levels_->used();
  Eigen::MatrixXd result(static_cast<Eigen::Index>(used.size()), misfit.cols());
  parallel_for(context, used_.tiles(), tiles_per_task, [&](std::size_t begin, std::size_t end) {
    std::vector<double> values(columns * tile_size);
    for (std::size_t t = begin; t < end; ++t) {
      std::fill(values.begin(), values.end(), 0.0);
      interpolate_tile_columns(system_, used_.tile(t), coefficients.data(), columns, columns, values.data());
      for (std::size_t i = t * tile_size; i < std::min((t + 1) * tile_size, used.size()); ++i) {
        for (std::size_t c = 0; c < columns; ++c) {
          const auto column = static_cast<Eigen::Index>(c);
          result(static_cast<Eigen::Index>(i), column) =
              misfit(static_cast<Eigen::Index>(used[i]), column) - values[c * tile_size + i % tile_size];
        }
      }
    }
  });
  return result;
}

Eigen::MatrixXd ResidualCorrection::values(const SparseRows& misfits, std::span<const std::int64_t> rows,
                                           std::span<const Vec3> places, const RunContext& context) const {
  constexpr std::size_t columns_at_once = 64, tiles_per_task = 16;
  const TiledPoints tiled(places);
  const auto smooth = static_cast<Eigen::Index>(smooth_rows());
  Eigen::MatrixXd result(static_cast<Eigen::Index>(places.size()), static_cast<Eigen::Index>(rows.size()));
  for (std::size_t first = 0; first < rows.size(); first += columns_at_once) {
    context.check();
    const std::span<const std::int64_t> some = rows.subspan(first, std::min(columns_at_once, rows.size() - first));
    const std::size_t columns = some.size();
    Eigen::MatrixXd misfit = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(held_), static_cast<Eigen::Index>(columns));
    for (std::size_t c = 0; c < columns; ++c) {
      for (SparseRows::InnerIterator it(misfits, some[c]); it; ++it) misfit(it.col(), static_cast<Eigen::Index>(c)) = it.value();
    }
    Eigen::MatrixXd at_centres(static_cast<Eigen::Index>(centres_.size()), misfit.cols());
    for (std::size_t j = 0; j < centres_.size(); ++j) {
      at_centres.row(static_cast<Eigen::Index>(j)) = misfit.row(static_cast<Eigen::Index>(centres_[j]));
    }
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> coefficients(static_cast<Eigen::Index>(this->rows()),
                                                                                        misfit.cols());
    coefficients.topRows(smooth) = system_.unrefined(at_centres);
    if (levels_) {
      coefficients.bottomRows(coefficients.rows() - smooth) =
          levels_->coefficients(left(misfit, coefficients.topRows(smooth), context), context);
    }
    parallel_for(context, tiled.tiles(), tiles_per_task, [&](std::size_t begin, std::size_t end) {
      std::vector<double> values(columns * tile_size);
      for (std::size_t t = begin; t < end; ++t) {
        std::fill(values.begin(), values.end(), 0.0);
        add_values(tiled.tile(t), coefficients.data(), columns, values.data());
        for (std::size_t i = t * tile_size; i < std::min((t + 1) * tile_size, places.size()); ++i) {
          for (std::size_t c = 0; c < columns; ++c) {
            result(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(first + c)) = values[c * tile_size + i % tile_size];
          }
        }
      }
    });
  }
  return result;
}

double ResidualCorrection::rounding(const Eigen::MatrixXd& coefficients, std::span<const Vec3> at,
                                    const RunContext& context) const {
  const auto smooth = static_cast<Eigen::Index>(smooth_rows());
  Interpolants interpolants;
  interpolants.coefficients = coefficients.topRows(smooth);
  double result = system_.rounding(interpolants, at, context);
  if (levels_) {
    for (Eigen::Index c = 0; c < coefficients.cols(); ++c) {
      result = std::max(result, levels_->rounding(coefficients.col(c).data() + smooth, 1, at));
    }
  }
  return result;
}

void ResidualCorrection::add_values(const double* tile, const double* coefficients, std::size_t columns, double* out) const {
  interpolate_tile_columns(system_, tile, coefficients, columns, columns, out);
  if (levels_) levels_->add_values(tile, coefficients + smooth_rows() * columns, columns, out);
}

/// The levels take what the smooth interpolant leaves of the misfit at their points, so that it acts there as well, negatively.
Eigen::MatrixXd ResidualCorrection::adjoint(std::span<const Vec3> points, std::span<const Vec3> X,
                                            const RunContext& context) const {
  if (!levels_) return smooth_adjoint(points, X, context);
  const Eigen::MatrixXd back = levels_->adjoint(points, X, context);
  std::vector<Vec3> places(points.begin(), points.end()), all(X.begin(), X.end());
  places.insert(places.end(), levels_->used_places().begin(), levels_->used_places().end());
  for (Eigen::Index i = 0; i < back.rows(); ++i) all.push_back({-back(i, 0), -back(i, 1), -back(i, 2)});
  Eigen::MatrixXd result = smooth_adjoint(places, all, context);
  for (std::size_t i = 0; i < levels_->used().size(); ++i) {
    result.row(static_cast<Eigen::Index>(levels_->used()[i])) += back.row(static_cast<Eigen::Index>(i));
  }
  return result;
}

/// u = [Phi P] S [values; 0] with the symmetric S, so the transpose is the first rows of S [Phi^T; P^T].
Eigen::MatrixXd ResidualCorrection::smooth_adjoint(std::span<const Vec3> points, std::span<const Vec3> X,
                                                   const RunContext& context) const {
  const auto m = static_cast<Eigen::Index>(system_.size());
  const std::size_t q = system_.polynomials().terms();
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(smooth_rows()), 3);
  if (!points.empty()) {
    const std::vector<double> sums = system_.sums_at_centres(points, {X[0].data(), 3 * X.size()}, 3, context);
    for (Eigen::Index j = 0; j < m; ++j) {
      for (Eigen::Index k = 0; k < 3; ++k) B(j, k) = sums[static_cast<std::size_t>(3 * j + k)];
    }
  }
  std::vector<double> terms(q);
  for (std::size_t i = 0; i < points.size(); ++i) {
    system_.polynomials().values(points[i], terms.data());
    for (std::size_t t = 0; t < q; ++t) {
      for (std::size_t k = 0; k < 3; ++k) B(m + static_cast<Eigen::Index>(t), static_cast<Eigen::Index>(k)) += terms[t] * X[i][k];
    }
  }
  const Eigen::MatrixXd back = system_.adjoint(std::move(B), context);
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(held_), 3);
  for (std::size_t j = 0; j < centres_.size(); ++j) {
    result.row(static_cast<Eigen::Index>(centres_[j])) = back.row(static_cast<Eigen::Index>(j));
  }
  return result;
}

}  // namespace deform
