// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/support/linear_algebra.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <Eigen/SVD>

namespace deform::test {

template <class Scalar>
Lu<Scalar>::Lu(const Dense<Scalar>& A) : lu_(A) {}

template <class Scalar>
void Lu<Scalar>::compute(const Dense<Scalar>& A) {
  lu_.compute(A);
}

template <class Scalar>
Dense<Scalar> Lu<Scalar>::solve(const Dense<Scalar>& B) const {
  return lu_.solve(B);
}

template class Lu<double>;
template class Lu<long double>;

template <class Scalar>
Dense<Scalar> LinearAlgebra<Scalar>::product(const Matrix& A, const Matrix& B) {
  return A * B;
}

template <class Scalar>
Dense<Scalar> LinearAlgebra<Scalar>::lu(const Matrix& A, const Matrix& B) {
  return Lu<Scalar>(A).solve(B);
}

template <class Scalar>
Dense<Scalar> LinearAlgebra<Scalar>::full_lu(const Matrix& A, const Matrix& B) {
  return Eigen::FullPivLU<Matrix>(A).solve(B);
}

template <class Scalar>
Dense<Scalar> LinearAlgebra<Scalar>::ldlt(const Matrix& A, const Matrix& B) {
  return Eigen::LDLT<Matrix>(A).solve(B);
}

template <class Scalar>
Dense<Scalar> LinearAlgebra<Scalar>::qr(const Matrix& A, const Matrix& B) {
  return Eigen::ColPivHouseholderQR<Matrix>(A).solve(B);
}

template <class Scalar>
Dense<Scalar> LinearAlgebra<Scalar>::least_norm(const Matrix& A, const Matrix& B) {
  return Eigen::CompleteOrthogonalDecomposition<Matrix>(A).solve(B);
}

template <class Scalar>
ThinSvd<Scalar> LinearAlgebra<Scalar>::svd(const Matrix& A) {
  const Eigen::JacobiSVD<Matrix> svd(A, Eigen::ComputeThinU | Eigen::ComputeThinV);
  return {svd.matrixU(), svd.singularValues(), svd.matrixV()};
}

template <class Scalar>
Eigen::Matrix<Scalar, Eigen::Dynamic, 1> LinearAlgebra<Scalar>::eigenvalues(const Matrix& A) {
  return Eigen::SelfAdjointEigenSolver<Matrix>(A, Eigen::EigenvaluesOnly).eigenvalues();
}

template <class Scalar>
Dense<Scalar> LinearAlgebra<Scalar>::orthogonal(const Matrix& A) {
  return Eigen::HouseholderQR<Matrix>(A).householderQ();
}

template struct LinearAlgebra<double>;
template struct LinearAlgebra<long double>;

}  // namespace deform::test
