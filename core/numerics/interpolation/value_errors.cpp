// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/value_errors.h"

#include <cmath>
#include <limits>

#include "core/numerics/kernels/residual.h"

namespace deform {

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
  // NaN has an infinite error.
  return errors.unaryExpr([](double error) { return std::isnan(error) ? std::numeric_limits<double>::infinity() : error; });
}

}  // namespace deform
