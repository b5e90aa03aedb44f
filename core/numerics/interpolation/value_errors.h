// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <span>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/interpolation/interpolator.h"

namespace deform {

/// How far values of the interpolants of a dense solver may be off at n points: n x columns, at least 0. They are compared with
/// sums in double-double (accurate_residual()), what the uncertainty of the coefficients comes to is added, and so is the
/// rounding of the stored coefficients, taken as independent. `values`: as delivered, n x columns. Throws Error(cancelled),
/// deadline_exceeded.
Eigen::MatrixXd value_errors(const Interpolator& system, const Interpolants& interpolants, std::span<const Vec3> points,
                             const Eigen::MatrixXd& values, const RunContext& context);

}  // namespace deform
