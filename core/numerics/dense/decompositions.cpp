// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/dense/decompositions.h"

#include <Eigen/Cholesky>
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
Svd<Eigen::Dynamic> svd(const Eigen::MatrixXd& A) { return svd_of<Eigen::Dynamic>(A); }

struct HouseholderQr::Parts {
  Eigen::HouseholderQR<Eigen::MatrixXd> qr;
};

HouseholderQr::HouseholderQr(const Eigen::MatrixXd& A)
    : parts_(std::make_unique<const Parts>(Parts{Eigen::HouseholderQR<Eigen::MatrixXd>(A)})) {}
HouseholderQr::~HouseholderQr() = default;
HouseholderQr::HouseholderQr(HouseholderQr&&) noexcept = default;
HouseholderQr& HouseholderQr::operator=(HouseholderQr&&) noexcept = default;

const Eigen::MatrixXd& HouseholderQr::packed() const { return parts_->qr.matrixQR(); }
const Eigen::VectorXd& HouseholderQr::factors() const { return parts_->qr.hCoeffs(); }
Eigen::MatrixXd HouseholderQr::leading_q(Eigen::Index columns) const {
  return parts_->qr.householderQ() * Eigen::MatrixXd::Identity(parts_->qr.rows(), columns);
}
Eigen::VectorXd HouseholderQr::solve(const Eigen::VectorXd& b) const { return parts_->qr.solve(b); }
Eigen::MatrixXd HouseholderQr::solve(const Eigen::MatrixXd& B) const { return parts_->qr.solve(B); }

Eigen::MatrixXd symmetric_solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) { return A.ldlt().solve(B); }

std::vector<Eigen::Index> independent_columns(const Eigen::MatrixXd& A, double threshold) {
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(A);
  qr.setThreshold(threshold);
  std::vector<Eigen::Index> columns;
  for (Eigen::Index i = 0; i < qr.rank(); ++i) columns.push_back(qr.colsPermutation().indices()[i]);
  return columns;
}

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
