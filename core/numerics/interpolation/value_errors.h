// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <span>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/interpolation/interpolator.h"

namespace deform {

/// Estimates the errors of `values` (n x columns), computed from the interpolants of a dense solver at n points: n x columns,
/// nonnegative. Adds the differences from double-double sums (accurate_residual()), the propagated uncertainty of the
/// coefficients, and the rounding of the stored coefficients, assumed independent. Throws Error(cancelled), deadline_exceeded.
Eigen::MatrixXd value_errors(const Interpolator& system, const Interpolants& interpolants, std::span<const Vec3> points,
                             const Eigen::MatrixXd& values, const RunContext& context);

}  // namespace deform
