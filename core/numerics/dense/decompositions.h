// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

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

/// The singular value decomposition A = U diag(values) V^T with orthogonal U and V and the values in descending order. A may be
/// rectangular only where its sizes are dynamic.
template <int n>
struct Svd {
  Eigen::Matrix<double, n, 1> values;
  Eigen::Matrix<double, n, n> U, V;
};

Svd<2> svd(const Eigen::Matrix2d& A);
Svd<3> svd(const Eigen::Matrix3d& A);
Svd<Eigen::Dynamic> svd(const Eigen::MatrixXd& A);

/// The decomposition A = Q R of an m x n matrix into Householder reflections (Golub, Van Loan: Matrix Computations, section 5.2).
class HouseholderQr {
 public:
  explicit HouseholderQr(const Eigen::MatrixXd& A);
  ~HouseholderQr();
  HouseholderQr(HouseholderQr&&) noexcept;
  HouseholderQr& operator=(HouseholderQr&&) noexcept;

  /// m x n: R in the upper triangle, and below the diagonal the reflections, whose first entry is 1.
  const Eigen::MatrixXd& packed() const;
  /// The factors tau of the reflections 1 - tau v v^T.
  const Eigen::VectorXd& factors() const;
  /// The first columns of Q.
  Eigen::MatrixXd leading_q(Eigen::Index columns) const;
  /// The X of least |A X - B|, for A of full column rank.
  Eigen::VectorXd solve(const Eigen::VectorXd& b) const;
  Eigen::MatrixXd solve(const Eigen::MatrixXd& B) const;

 private:
  struct Parts;
  std::unique_ptr<const Parts> parts_;
};

/// The X of A X = B for a symmetric semidefinite A, of which only the lower triangle is read.
Eigen::MatrixXd symmetric_solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

/// Columns of A that are independent of each other, in the order of their pivots: those whose pivots are larger than `threshold`
/// times the largest.
std::vector<Eigen::Index> independent_columns(const Eigen::MatrixXd& A, double threshold);

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
