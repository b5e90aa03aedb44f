// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <functional>

namespace deform {

/// Estimates the 1-norm of A^-1 for a symmetric matrix from a few solves (Higham, FORTRAN codes for estimating the one-norm,
/// ACM TOMS 14, 1988). The estimate is a lower bound, rarely off by more than a factor of 3. `solve` replaces its argument b by
/// A^-1 b.
double inverse_norm1(Eigen::Index size, const std::function<void(Eigen::VectorXd&)>& solve);

}  // namespace deform
