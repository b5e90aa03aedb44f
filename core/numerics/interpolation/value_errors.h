// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <limits>
#include <random>
#include <span>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/interpolation/interpolator.h"

namespace deform {

/// Estimates the errors of `values` (n x columns), computed from the interpolants of a dense solver at n points: n x columns,
/// nonnegative. Adds the differences from double-double sums (accurate_residual()), the propagated uncertainty of the
/// coefficients, and the rounding of the stored coefficients, assumed independent; of kernels that fall off from each centre also
/// that of the coordinates, which their slopes multiply where centres are close to each other. Throws Error(cancelled),
/// deadline_exceeded.
Eigen::MatrixXd value_errors(const Interpolator& system, const Interpolants& interpolants, std::span<const Vec3> points,
                             const Eigen::MatrixXd& values, const RunContext& context);

/// What rounding makes of the first m rows of B, values at centres: their largest of each column times epsilon, with random signs
/// (always the same), and 0 in the other rows. Kernels with a shape can swing, and multiply between the centres what is lost
/// there.
template <typename Matrix>
Matrix rounding_of_values(const Matrix& B, Eigen::Index m) {
  Matrix result = Matrix::Zero(B.rows(), B.cols());
  std::minstd_rand signs;
  const Eigen::RowVectorXd sizes = std::numeric_limits<double>::epsilon() * B.topRows(m).cwiseAbs().colwise().maxCoeff();
  for (Eigen::Index i = 0; i < m; ++i) {
    const double sign = signs() % 2 == 0 ? 1 : -1;
    result.row(i) = (sign * sizes).template cast<typename Matrix::Scalar>();
  }
  return result;
}

}  // namespace deform
