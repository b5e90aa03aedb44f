// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <span>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/kernels/kernel.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

/// Computes F - Phi W - P C (n x columns) at n points, where Phi_ij = phi(|x_i - c_j|) (with the images of a parity), X = [W; C]
/// and P is n x q, for iterative refinement and for the error of an interpolant. Distances, kernel and sums are in double-double
/// arithmetic (Hida, Li, Bailey 2001), so that the result is accurate to its last digits although it is a small difference of
/// large numbers. Exponentials and logarithms have 21 digits. Bitwise independent of the number of threads.
Eigen::MatrixXd accurate_residual(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres,
                                  const Eigen::MatrixXd& P, const Eigen::MatrixXd& X, const Eigen::MatrixXd& F,
                                  const RunContext& context);

/// high + low = phi(|x_i - centre|) - phi(|x_i - other|) at tiled points, without the second where `other` is null, in
/// double-double arithmetic as above. high, low: 16 for each tile. Any thread.
void accurate_column(const RadialKernel& kernel, const TiledPoints& points, const Vec3& centre, const Vec3* other, double* high,
                     double* low);

/// sqrt(sum over the centres of |phi(|x_i - c_j|) w_jc|^2), n x columns, from the first m rows of W: the effect at n points of
/// independent relative errors of size one in the kernel or the weights. Throws Error(cancelled), deadline_exceeded.
Eigen::MatrixXd root_square_sums(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres,
                                 const Eigen::MatrixXd& W, const RunContext& context);

}  // namespace deform
