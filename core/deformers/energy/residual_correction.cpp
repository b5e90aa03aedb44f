// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/residual_correction.h"

#include <algorithm>
#include <utility>

#include "core/deformers/handles/interpolant_tiles.h"
#include "core/numerics/sampling/farthest_points.h"

namespace deform {

namespace {

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

std::size_t ResidualCorrection::centres_for(std::size_t points) {
  constexpr std::size_t evaluations = 120'000'000;
  return std::clamp<std::size_t>(evaluations / std::max<std::size_t>(1, points), 600, 2000);
}

ResidualCorrection::ResidualCorrection(std::span<const Vec3> places, std::size_t most_centres, const RunContext& context)
    : ResidualCorrection(places, farthest_point_order(places, most_centres), Kind::smooth, context) {}

ResidualCorrection::ResidualCorrection(std::span<const Vec3> places, std::vector<std::uint32_t> centres, Kind kind,
                                       const RunContext& context)
    : held_(places.size()), centres_(std::move(centres)), system_(subset(places, centres_), options_of(kind), context) {}

Eigen::MatrixXd ResidualCorrection::coefficients(const Eigen::MatrixXd& misfit, const RunContext& context) const {
  Eigen::MatrixXd values(static_cast<Eigen::Index>(centres_.size()), misfit.cols());
  for (std::size_t j = 0; j < centres_.size(); ++j) {
    values.row(static_cast<Eigen::Index>(j)) = misfit.row(static_cast<Eigen::Index>(centres_[j]));
  }
  // Column by column: BLAS sums in another order for another number of columns.
  Eigen::MatrixXd result(static_cast<Eigen::Index>(rows()), misfit.cols());
  for (Eigen::Index c = 0; c < misfit.cols(); ++c) result.col(c) = system_.interpolate(values.col(c), 0, context).coefficients;
  return result;
}

double ResidualCorrection::rounding(const Eigen::MatrixXd& coefficients, std::span<const Vec3> at,
                                    const RunContext& context) const {
  Interpolants interpolants;
  interpolants.coefficients = coefficients;
  return system_.rounding(interpolants, at, context);
}

void ResidualCorrection::add_values(const double* tile, const double* coefficients, std::size_t columns, double* out) const {
  interpolate_tile_columns(system_, tile, coefficients, columns, columns, out);
}

/// u = [Phi P] S [values; 0] with the symmetric S, so the transpose is the first rows of S [Phi^T; P^T].
Eigen::MatrixXd ResidualCorrection::adjoint(std::span<const Vec3> points, std::span<const Vec3> X,
                                            const RunContext& context) const {
  const auto m = static_cast<Eigen::Index>(system_.size());
  const std::size_t q = system_.polynomials().terms();
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(rows()), 3);
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
