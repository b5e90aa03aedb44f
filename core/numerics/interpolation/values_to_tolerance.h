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

/// Values of interpolants at points, and how wrong they may be there.
struct CheckedValues {
  std::vector<double> values;  ///< n x columns, row by row
  /// At the points that are checked x columns: exact interpolant - value, estimated; of the coefficients and of the sums.
  Eigen::MatrixXd errors;
  /// To be added for what may be worse at other points: beside the worst centres, by sums that are not direct, and by rounding.
  double more = 0;
  double error = 0;       ///< error_margin times the largest of the errors, and `more`
  double residual = 0;    ///< Interpolants::residual
  bool converged = true;  ///< iterative: error <= tolerance; incremental QR: Interpolants::converged
};

/// By a solver to a tolerance (units of the values). That of the iterative one holds at the points: it goes on until what is left
/// at the centres, grown by as much as it does on its way to the points, and what fast sums leave out are within it together.
/// That of incremental QR is the one of Interpolator::interpolate(). check: places are the points with the numbers `checked`.
/// Deterministic; any thread. Throws Error(cancelled), deadline_exceeded.
CheckedValues values_to_tolerance(const Interpolator& system, const PointErrors& check, std::span<const std::uint32_t> checked,
                                  const Eigen::MatrixXd& F, double tolerance, std::span<const Vec3> points,
                                  const RunContext& context);

}  // namespace deform
