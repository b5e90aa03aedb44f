// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/interpolation/point_errors.h"

namespace deform {

/// Interpolants and how their values are computed.
struct SolvedValues {
  Interpolants interpolants;
  /// Whether values are summed with twice the digits, because rounding alone would miss the tolerance.
  enum class Sums { usual, accurate } sums = Sums::usual;
};

/// Values of interpolants at points, with their errors.
struct CheckedValues {
  SolvedValues from;
  std::vector<double> values;  ///< n x columns, row by row
  /// Estimated exact - computed values, checked points x columns: errors of the coefficients and of the sums.
  Eigen::MatrixXd errors;
  /// An allowance for each column for larger errors at the other points, by sums that are not direct, and by rounding.
  Eigen::VectorXd more;
  double error = 0;       ///< error_margin times the largest of `errors`, plus the largest of `more`
  double residual = 0;    ///< Interpolants::residual
  bool converged = true;  ///< iterative: error <= tolerance; incremental QR: Interpolants::converged
};

/// Computes values with a solver that works to a tolerance, in the units of the values. The iterative solver keeps the tolerance
/// at the points: it iterates until the residual at the centres, amplified as `check` measures it, and the error of the fast sums
/// together are within it. For incremental QR the tolerance is that of Interpolator::interpolate(). The places of `check` are the
/// points with the indices `checked`. Deterministic; any thread. Throws Error(cancelled), deadline_exceeded.
CheckedValues values_to_tolerance(const Interpolator& system, const PointErrors& check, std::span<const std::uint32_t> checked,
                                  const Eigen::MatrixXd& F, double tolerance, std::span<const Vec3> points,
                                  const RunContext& context);

/// Values at other points (n x columns, row by row), computed in the same way. Sets `sums_error` to the error of sums that are
/// not direct, estimated at these points. With the iterative solver digits below its tolerance depend on the points that are
/// summed together. Deterministic; any thread. Throws Error(cancelled), deadline_exceeded.
std::vector<double> values_elsewhere(const Interpolator& system, const SolvedValues& solved, std::span<const Vec3> points,
                                     double& sums_error, const RunContext& context);

}  // namespace deform
