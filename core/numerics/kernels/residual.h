// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <span>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/kernels/kernel.h"

namespace deform {

/// F - Phi W - P C (m x columns) with Phi_ij = phi(|x_i - x_j|) (and the images of a parity), X = [W; C] and P of m x q, for
/// iterative refinement: distances, kernel and sums carry twice the digits of a double (double-double arithmetic; Hida, Li,
/// Bailey 2001), so that the result is right to its last digits although it is a small difference of large numbers. The
/// Gaussian's exponential has the digits of a double, its sums twice as many. Bitwise independent of the number of threads.
Eigen::MatrixXd accurate_residual(const RadialKernel& kernel, std::span<const Vec3> centres, const Eigen::MatrixXd& P,
                                  const Eigen::MatrixXd& X, const Eigen::MatrixXd& F, const RunContext& context);

}  // namespace deform
