// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>

namespace deform {

/// A = U diag(values) V^T with min(m, n) columns in U and V (Golub, Van Loan, 2.4): LAPACK's divide and conquer on one thread.
struct ThinSvd {
  Eigen::MatrixXd U;       ///< m x min(m, n)
  Eigen::VectorXd values;  ///< descending
  Eigen::MatrixXd V;       ///< n x min(m, n)
};

/// Throws Error(numerical_failure) when the iteration does not converge, or A is not finite.
ThinSvd thin_svd(Eigen::MatrixXd A);

/// Bytes that thin_svd() needs at its peak, with what is given and returned: an upper bound.
std::size_t thin_svd_bytes(std::size_t rows, std::size_t columns);

}  // namespace deform
