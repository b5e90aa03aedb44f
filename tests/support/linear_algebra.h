// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/LU>

/// Eigen's decompositions for what tests compare with, compiled once: each takes seconds in every file that instantiates it. They
/// share nothing with core/numerics/dense/decompositions.h. Scalars are double and long double.
namespace deform::test {

template <class Scalar>
using Dense = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;

/// The thin singular value decomposition A = U diag(values) V^T by Jacobi rotations, values in descending order.
template <class Scalar>
struct ThinSvd {
  Dense<Scalar> U;
  Eigen::Matrix<Scalar, Eigen::Dynamic, 1> values;
  Dense<Scalar> V;
};

/// LU with pivots in columns, for several right sides.
template <class Scalar>
class Lu {
 public:
  Lu() = default;
  explicit Lu(const Dense<Scalar>& A);
  void compute(const Dense<Scalar>& A);
  Dense<Scalar> solve(const Dense<Scalar>& B) const;

 private:
  Eigen::PartialPivLU<Dense<Scalar>> lu_;
};
extern template class Lu<double>;
extern template class Lu<long double>;

/// The matrices of one scalar, evaluated.
template <class Scalar>
struct LinearAlgebra {
  using Matrix = Dense<Scalar>;
  static Matrix product(const Matrix& A, const Matrix& B);
  static Matrix lu(const Matrix& A, const Matrix& B);
  static Matrix full_lu(const Matrix& A, const Matrix& B);
  static Matrix ldlt(const Matrix& A, const Matrix& B);
  static Matrix qr(const Matrix& A, const Matrix& B);
  static Matrix least_norm(const Matrix& A, const Matrix& B);
  static ThinSvd<Scalar> svd(const Matrix& A);
  static Eigen::Matrix<Scalar, Eigen::Dynamic, 1> eigenvalues(const Matrix& A);
  static Matrix orthogonal(const Matrix& A);
};
extern template struct LinearAlgebra<double>;
extern template struct LinearAlgebra<long double>;

/// A B
template <class A, class B>
auto product(const Eigen::MatrixBase<A>& a, const Eigen::MatrixBase<B>& b) {
  return LinearAlgebra<typename A::Scalar>::product(a, b);
}
/// The X of A X = B, by LU with pivots in columns.
template <class A, class B>
auto lu_solution(const Eigen::MatrixBase<A>& a, const Eigen::MatrixBase<B>& b) {
  return LinearAlgebra<typename A::Scalar>::lu(a, b);
}
/// The same with pivots in rows and columns.
template <class A, class B>
auto full_lu_solution(const Eigen::MatrixBase<A>& a, const Eigen::MatrixBase<B>& b) {
  return LinearAlgebra<typename A::Scalar>::full_lu(a, b);
}
/// The X of A X = B for a symmetric semidefinite A.
template <class A, class B>
auto ldlt_solution(const Eigen::MatrixBase<A>& a, const Eigen::MatrixBase<B>& b) {
  return LinearAlgebra<typename A::Scalar>::ldlt(a, b);
}
/// The X of least |A X - B|, by QR with pivots, for A of full column rank.
template <class A, class B>
auto least_squares(const Eigen::MatrixBase<A>& a, const Eigen::MatrixBase<B>& b) {
  return LinearAlgebra<typename A::Scalar>::qr(a, b);
}
/// The X of least |A X - B|, and of these the one of least norm, by a complete orthogonal decomposition.
template <class A, class B>
auto least_norm_solution(const Eigen::MatrixBase<A>& a, const Eigen::MatrixBase<B>& b) {
  return LinearAlgebra<typename A::Scalar>::least_norm(a, b);
}
template <class A>
auto thin_svd(const Eigen::MatrixBase<A>& a) {
  return LinearAlgebra<typename A::Scalar>::svd(a);
}
/// Eigenvalues of a symmetric matrix in ascending order.
template <class A>
auto symmetric_eigenvalues(const Eigen::MatrixBase<A>& a) {
  return LinearAlgebra<typename A::Scalar>::eigenvalues(a);
}
/// The square Q of A = Q R, by Householder's reflections.
template <class A>
auto orthogonal_of(const Eigen::MatrixBase<A>& a) {
  return LinearAlgebra<typename A::Scalar>::orthogonal(a);
}

}  // namespace deform::test
