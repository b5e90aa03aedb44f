// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>

namespace deform {

/// The thin singular value decomposition A = U diag(values) V^T of an m x n matrix (Golub, Van Loan, 2.4), by LAPACK's
/// divide-and-conquer algorithm on one thread.
struct ThinSvd {
  Eigen::MatrixXd U;       ///< m x min(m, n)
  Eigen::VectorXd values;  ///< descending
  Eigen::MatrixXd V;       ///< n x min(m, n)
};

/// Throws Error(numerical_failure) if the iteration does not converge or A is not finite.
ThinSvd thin_svd(Eigen::MatrixXd A);

/// An upper bound of the peak memory of thin_svd() in bytes, including its argument and its result.
std::size_t thin_svd_bytes(std::size_t rows, std::size_t columns);

}  // namespace deform
