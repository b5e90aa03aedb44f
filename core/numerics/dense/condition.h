// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <functional>

namespace deform {

/// Estimate of the 1-norm of A^-1 for a symmetric matrix, from a handful of solves (Higham, FORTRAN codes for estimating the
/// one-norm, ACM TOMS 14, 1988). A lower bound, rarely off by more than a factor of 3. solve replaces its argument by A^-1 times
/// it.
double inverse_norm1(Eigen::Index size, const std::function<void(Eigen::VectorXd&)>& solve);

}  // namespace deform
