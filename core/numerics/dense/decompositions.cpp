// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/dense/decompositions.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <Eigen/SVD>

namespace deform {

namespace {

template <int n>
SymmetricEigen<n> eigen_of(const Eigen::Matrix<double, n, n>& A) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, n, n>> eigen(A);
  return {eigen.eigenvalues(), eigen.eigenvectors()};
}

template <int n>
Svd<n> svd_of(const Eigen::Matrix<double, n, n>& A) {
  const Eigen::JacobiSVD<Eigen::Matrix<double, n, n>> svd(A, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return {svd.singularValues(), svd.matrixU(), svd.matrixV()};
}

}  // namespace

SymmetricEigen<2> symmetric_eigen(const Eigen::Matrix2d& A) { return eigen_of<2>(A); }
SymmetricEigen<3> symmetric_eigen(const Eigen::Matrix3d& A) { return eigen_of<3>(A); }
SymmetricEigen<Eigen::Dynamic> symmetric_eigen(const Eigen::MatrixXd& A) { return eigen_of<Eigen::Dynamic>(A); }

Svd<2> svd(const Eigen::Matrix2d& A) { return svd_of<2>(A); }
Svd<3> svd(const Eigen::Matrix3d& A) { return svd_of<3>(A); }

PivotedSolution pivoted_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(A);
  return {qr.solve(b), qr.rank()};
}

Eigen::VectorXd least_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
  return Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd>(A).solve(b);
}

Eigen::MatrixXd least_solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, double threshold) {
  Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> decomposition;
  decomposition.setThreshold(threshold);
  decomposition.compute(A);
  return decomposition.solve(B);
}

}  // namespace deform
