// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>

// The decompositions of small matrices, compiled once: each file that instantiates one of Eigen takes seconds longer to compile.
// Deterministic. Any thread may call any of them.

namespace deform {

/// The eigenvalues of a symmetric n x n matrix in ascending order, and its orthonormal eigenvectors as columns.
template <int n>
struct SymmetricEigen {
  Eigen::Matrix<double, n, 1> values;
  Eigen::Matrix<double, n, n> vectors;
};

/// Reads the lower triangle only.
SymmetricEigen<2> symmetric_eigen(const Eigen::Matrix2d& A);
SymmetricEigen<3> symmetric_eigen(const Eigen::Matrix3d& A);
SymmetricEigen<Eigen::Dynamic> symmetric_eigen(const Eigen::MatrixXd& A);

/// The singular value decomposition A = U diag(values) V^T of an n x n matrix, with the values in descending order.
template <int n>
struct Svd {
  Eigen::Matrix<double, n, 1> values;
  Eigen::Matrix<double, n, n> U, V;
};

Svd<2> svd(const Eigen::Matrix2d& A);
Svd<3> svd(const Eigen::Matrix3d& A);

/// The x of least |A x - b| by the QR decomposition of A with column pivoting. The rank is the number of pivots above rounding
/// errors; x divides by smaller ones as well, unless they vanish, so that it is large where columns are dependent.
struct PivotedSolution {
  Eigen::VectorXd x;
  Eigen::Index rank = 0;
};
PivotedSolution pivoted_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);

/// The X of least |A X - B|, and among these the one of least length.
Eigen::VectorXd least_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
Eigen::MatrixXd least_solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, double threshold);

}  // namespace deform
