// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/value_errors.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/numerics/kernels/residual.h"

namespace deform {

namespace {

using Eigen::Index;

double slope(const RadialKernel& kernel, double r2) {
  constexpr double share = 1e-4;  // of the distance: the difference has eight digits
  if (!(r2 > 0)) return 0;
  const double more = (1 + share) * (1 + share), less = (1 - share) * (1 - share);
  return (value(kernel, r2 * more) - value(kernel, r2 * less)) / (2 * share * std::sqrt(r2));
}

/// The effect of the rounding of points and centres, which are no longer where they were in the model: independent, and of each
/// coordinate a share of the distance from the origin. n x columns.
Eigen::MatrixXd coordinate_rounding(const Interpolator& system, const Interpolants& interpolants, std::span<const Vec3> points,
                                    const RunContext& context) {
  const auto n = static_cast<Index>(points.size());
  const Index columns = interpolants.coefficients.cols();
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(n, columns);
  const std::vector<Vec3>& centres = system.centres();
  const Images images(system.kernel().parity);
  parallel_for(context, points.size(), 4, [&](std::size_t begin, std::size_t end) {
    Eigen::VectorXd row(static_cast<Index>(centres.size()));
    for (std::size_t i = begin; i < end; ++i) {
      for (std::size_t j = 0; j < centres.size(); ++j) {
        double square = 0;
        for (std::size_t g = 0; g < images.count; ++g) {
          const Vec3 c = images.at[g].of(centres[j]);
          const double moved = std::max(norm(points[i]), norm(c)) * slope(system.kernel(), squared_distance(points[i], c));
          square += moved * moved;
        }
        row[static_cast<Index>(j)] = std::sqrt(square);
      }
      for (Index c = 0; c < columns; ++c) {
        result(static_cast<Index>(i), c) = row.cwiseProduct(interpolants.coefficients.col(c).head(row.size())).norm();
      }
    }
  });
  return std::numeric_limits<double>::epsilon() / 2 * result;
}

}  // namespace

Eigen::MatrixXd value_errors(const Interpolator& system, const Interpolants& interpolants, std::span<const Vec3> points,
                             const Eigen::MatrixXd& values, const RunContext& context) {
  constexpr double rounding = std::numeric_limits<double>::epsilon() / 2;
  Eigen::MatrixXd errors = system.accurate_residual(interpolants, points, values, context).cwiseAbs();
  if (interpolants.uncertainty.size() > 0) {
    const Eigen::MatrixXd nothing = Eigen::MatrixXd::Zero(values.rows(), values.cols());
    Interpolants uncertainty;
    uncertainty.coefficients = interpolants.uncertainty;
    errors += system.accurate_residual(uncertainty, points, nothing, context).cwiseAbs();
  }
  errors += rounding *
            (root_square_sums(system.kernel(), points, system.centres(), interpolants.coefficients, context) + values.cwiseAbs());
  if (properties(system.kernel().kernel).falls_off) errors += coordinate_rounding(system, interpolants, points, context);
  // NaN has an infinite error.
  return errors.unaryExpr([](double error) { return std::isnan(error) ? std::numeric_limits<double>::infinity() : error; });
}

}  // namespace deform
