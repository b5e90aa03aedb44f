// SPDX-License-Identifier: GPL-3.0-or-later
// Decompositions of random and singular matrices against what defines them.
#include "core/numerics/dense/decompositions.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <random>
#include <vector>

namespace deform::decompositions_test {
namespace {

constexpr double rounding = 1e-13;

class RandomMatrices {
 public:
  template <typename Matrix>
  void fill(Matrix& A) {
    for (Eigen::Index k = 0; k < A.size(); ++k) A.data()[k] = normal_(random_);
  }

 private:
  std::mt19937_64 random_{11};
  std::normal_distribution<double> normal_;
};

template <typename Matrix>
void expect_eigen(const Matrix& A) {
  const auto eigen = symmetric_eigen(A);
  const double size = A.norm();
  EXPECT_LE((eigen.vectors * eigen.values.asDiagonal() * eigen.vectors.transpose() - A).norm(), rounding * size);
  EXPECT_LE((eigen.vectors.transpose() * eigen.vectors - Matrix::Identity(A.rows(), A.cols())).norm(), rounding * 10);
  for (Eigen::Index k = 1; k < A.rows(); ++k) EXPECT_LE(eigen.values[k - 1], eigen.values[k]);
  // Only the lower triangle counts.
  Matrix other = A;
  other(0, A.cols() - 1) = 7;
  const auto same = symmetric_eigen(other);
  EXPECT_EQ(same.values, eigen.values);
  EXPECT_EQ(same.vectors, eigen.vectors);
}

TEST(Decompositions, EigenvectorsDiagonalizeTheLowerTriangle) {
  RandomMatrices random;
  for (int round = 0; round < 50; ++round) {
    Eigen::Matrix2d two;
    Eigen::Matrix3d three;
    Eigen::MatrixXd nine(9, 9);
    random.fill(two);
    random.fill(three);
    random.fill(nine);
    expect_eigen(Eigen::Matrix2d(two + two.transpose()));
    expect_eigen(Eigen::Matrix3d(three + three.transpose()));
    expect_eigen(Eigen::MatrixXd(nine + nine.transpose()));
  }
}

template <typename Matrix>
void expect_svd(const Matrix& A) {
  const auto [values, U, V] = svd(A);
  EXPECT_LE((U * values.asDiagonal() * V.transpose() - A).norm(), rounding * A.norm());
  EXPECT_LE((U.transpose() * U - Matrix::Identity()).norm(), 10 * rounding);
  EXPECT_LE((V.transpose() * V - Matrix::Identity()).norm(), 10 * rounding);
  for (Eigen::Index k = 0; k < A.rows(); ++k) EXPECT_GE(values[k], k + 1 < A.rows() ? values[k + 1] : 0);
}

TEST(Decompositions, SingularVectorsAreOrthogonalAlsoOfSingularMatrices) {
  RandomMatrices random;
  for (int round = 0; round < 50; ++round) {
    Eigen::Matrix2d two;
    Eigen::Matrix3d three;
    random.fill(two);
    random.fill(three);
    expect_svd(two);
    expect_svd(three);
    three.col(2) = three.col(0) - 2 * three.col(1);
    expect_svd(three);
    three.row(1).setZero();
    three.row(2).setZero();
    expect_svd(three);
  }
}

TEST(Decompositions, RectangularMatricesHaveSingularVectorsToo) {
  RandomMatrices random;
  Eigen::MatrixXd A(3, 7);
  random.fill(A);
  A.row(2) = A.row(0) + A.row(1);
  const auto [values, U, V] = svd(A);
  ASSERT_EQ(values.size(), 3);
  ASSERT_EQ(V.cols(), 7);
  EXPECT_LE((U * values.asDiagonal() * V.leftCols(3).transpose() - A).norm(), rounding * A.norm());
  EXPECT_LE((V.transpose() * V - Eigen::MatrixXd::Identity(7, 7)).norm(), 10 * rounding);
  EXPECT_LE(values[2], rounding * values[0]);
}

TEST(Decompositions, HouseholderQrIsMadeOfItsReflections) {
  RandomMatrices random;
  for (const Eigen::Index columns : {1, 4, 60}) {
    Eigen::MatrixXd A(70, columns), B(70, 2);
    random.fill(A);
    random.fill(B);
    const HouseholderQr qr(A);
    const Eigen::MatrixXd R = qr.packed().topRows(columns).triangularView<Eigen::Upper>(), Q = qr.leading_q(columns);
    EXPECT_LE((Q * R - A).norm(), rounding * A.norm());
    EXPECT_LE((Q.transpose() * Q - Eigen::MatrixXd::Identity(columns, columns)).norm(), 10 * rounding);
    Eigen::MatrixXd product = Eigen::MatrixXd::Identity(70, columns);
    for (Eigen::Index k = columns - 1; k >= 0; --k) {
      Eigen::VectorXd v = Eigen::VectorXd::Zero(70);
      v[k] = 1;
      v.tail(69 - k) = qr.packed().col(k).tail(69 - k);
      product -= qr.factors()[k] * v * (v.transpose() * product);
    }
    EXPECT_LE((product - Q).norm(), 10 * rounding);
    const Eigen::MatrixXd X = qr.solve(B);
    EXPECT_LE((A.transpose() * (A * X - B)).norm(), 1e-11);
    EXPECT_LE((qr.solve(Eigen::VectorXd(B.col(1))) - X.col(1)).norm(), 1e-12 * X.norm());
  }
}

TEST(Decompositions, SymmetricSolutionsReadTheLowerTriangle) {
  RandomMatrices random;
  Eigen::MatrixXd root(6, 6), X(6, 3);
  random.fill(root);
  random.fill(X);
  Eigen::MatrixXd A = root * root.transpose();
  const Eigen::MatrixXd B = A * X;
  A.triangularView<Eigen::StrictlyUpper>().setConstant(7);
  EXPECT_LE((symmetric_solution(A, B) - X).norm(), 1e-9 * X.norm());
}

TEST(Decompositions, IndependentColumnsLeaveOutWhatOthersMake) {
  RandomMatrices random;
  Eigen::MatrixXd A(20, 4);
  random.fill(A);
  A.col(1) *= 100;
  A.col(3) = A.col(0) - A.col(2);
  const std::vector<Eigen::Index> columns = independent_columns(A, 1e-9);
  ASSERT_EQ(columns.size(), 3u);
  EXPECT_EQ(columns[0], 1) << "the longest first";
  Eigen::MatrixXd kept(20, 3);
  for (Eigen::Index k = 0; k < 3; ++k) kept.col(k) = A.col(columns[static_cast<std::size_t>(k)]);
  EXPECT_GT(Eigen::FullPivLU<Eigen::MatrixXd>(kept).rank(), 2);
  A.col(3) += 1e-6 * A.col(1).cwiseAbs();
  EXPECT_EQ(independent_columns(A, 1e-9).size(), 4u);
}

TEST(Decompositions, PivotedSolutionsLeaveAResidualOrthogonalToTheColumns) {
  RandomMatrices random;
  Eigen::MatrixXd A(20, 4);
  Eigen::VectorXd b(20);
  random.fill(A);
  random.fill(b);
  const PivotedSolution full = pivoted_solution(A, b);
  EXPECT_EQ(full.rank, 4);
  EXPECT_LE((A.transpose() * (A * full.x - b)).norm(), 1e-12);
  A.col(3) = A.col(0) + A.col(1);
  EXPECT_EQ(pivoted_solution(A, b).rank, 3);
  A.col(3) += 1e-6 * b;
  EXPECT_EQ(pivoted_solution(A, b).rank, 4);
}

TEST(Decompositions, LeastSolutionsOfDependentColumnsAreTheShortest) {
  RandomMatrices random;
  Eigen::MatrixXd A(12, 3), B(12, 2);
  random.fill(A);
  random.fill(B);
  A.col(2) = A.col(0);
  // Columns 0 and 2 share their weight: the solution with A's two independent columns, halved.
  const Eigen::MatrixXd independent = A.leftCols<2>();
  const Eigen::MatrixXd y = (independent.transpose() * independent).inverse() * independent.transpose() * B;
  Eigen::MatrixXd expected(3, 2);
  expected << 0.5 * y.row(0), y.row(1), 0.5 * y.row(0);
  EXPECT_LE((least_solution(A, B, 1e-10) - expected).norm(), 1e-12);
  EXPECT_LE((least_solution(A, Eigen::VectorXd(B.col(0))) - expected.col(0)).norm(), 1e-12);
}

}  // namespace
}  // namespace deform::decompositions_test
