// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/dense/blocked_qr.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>

#include "tests/core/numerics/random_points.h"

namespace deform::blocked_qr_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

MatrixXd random_matrix(Index rows, Index columns, std::uint64_t seed) {
  const std::vector<double> values = test::random_values(static_cast<std::size_t>(rows * columns), seed);
  return Eigen::Map<const MatrixXd>(values.data(), rows, columns);
}

/// Appends the columns of A in blocks of these widths; how many of the last block were taken.
std::size_t append(BlockedQr& qr, const MatrixXd& A, const std::vector<std::size_t>& widths, int threads = 0) {
  RunContext context;
  context.threads = threads;
  std::size_t taken = 0, first = 0;
  for (const std::size_t width : widths) {
    const double* from = A.col(static_cast<Index>(first)).data();
    taken = qr.append(
        width, [&](double* out) { std::copy_n(from, A.rows() * static_cast<Index>(width), out); }, context);
    first += width;
  }
  return taken;
}

MatrixXd transposed(const BlockedQr& qr, MatrixXd Y) {
  for (std::size_t p = 0; p < qr.panels(); ++p) qr.apply_transposed(p, Y);
  return Y;
}

TEST(BlockedQr, FactorsWhatIsAppended) {
  const MatrixXd A = random_matrix(60, 40, 1);
  BlockedQr qr(60);
  EXPECT_EQ(append(qr, A, {7, 20, 1, 12}), 12u);
  EXPECT_EQ(qr.columns(), 40u);
  EXPECT_EQ(qr.panels(), 4u);
  EXPECT_EQ(qr.first(3), 28u);
  EXPECT_EQ(qr.width(3), 12u);
  EXPECT_LE(qr.bytes(), BlockedQr::bytes_for(60, 40, 20));
  // Q^T A = R is triangular, Q R = A.
  const MatrixXd R = transposed(qr, A);
  EXPECT_LE(R.triangularView<Eigen::StrictlyLower>().toDenseMatrix().cwiseAbs().maxCoeff(), 1e-13);
  MatrixXd back = R;
  qr.apply(qr.panels(), back);
  EXPECT_LE((back - A).cwiseAbs().maxCoeff(), 1e-13);
  // Q keeps lengths.
  const MatrixXd Y = random_matrix(60, 3, 2);
  EXPECT_NEAR(transposed(qr, Y).norm(), Y.norm(), 1e-13);
  for (const Index k : {40, 28, 15, 1}) {
    const MatrixXd triangle = R.topLeftCorner(k, k).triangularView<Eigen::Upper>(), B = random_matrix(k, 2, 3);
    MatrixXd x = B, y = B;
    qr.solve(static_cast<std::size_t>(k), x);
    qr.solve_transposed(static_cast<std::size_t>(k), y);
    EXPECT_LE((triangle * x - B).cwiseAbs().maxCoeff(), 1e-10) << k;
    EXPECT_LE((triangle.transpose() * y - B).cwiseAbs().maxCoeff(), 1e-10) << k;
  }
}

TEST(BlockedQr, LaterColumnsLeaveEarlierOnesAlone) {
  const MatrixXd A = random_matrix(50, 30, 4), Y = random_matrix(50, 2, 5);
  BlockedQr few(50), many(50);
  append(few, A, {10});
  append(many, A, {10, 20});
  MatrixXd a = Y, b = Y;
  few.apply_transposed(0, a);
  many.apply_transposed(0, b);
  EXPECT_TRUE(a == b);
}

TEST(BlockedQr, DoesNotDependOnThreads) {
  const MatrixXd A = random_matrix(300, 250, 6), Y = random_matrix(300, 2, 7);
  BlockedQr one(300), four(300);
  append(one, A, {100, 64, 86}, 1);
  append(four, A, {100, 64, 86}, 4);
  EXPECT_TRUE(transposed(one, Y) == transposed(four, Y));
}

TEST(BlockedQr, EndsAtADependentColumn) {
  MatrixXd A = random_matrix(40, 20, 8);
  A.col(13) = A.col(2) - 3 * A.col(11);
  BlockedQr qr(40);
  EXPECT_EQ(append(qr, A, {8, 12}), 5u);
  EXPECT_EQ(qr.columns(), 13u);
  const MatrixXd R = transposed(qr, A.leftCols(13));
  EXPECT_LE(R.triangularView<Eigen::StrictlyLower>().toDenseMatrix().cwiseAbs().maxCoeff(), 1e-13);
  BlockedQr nothing(40);
  EXPECT_EQ(append(nothing, MatrixXd::Zero(40, 2), {2}), 0u);
  EXPECT_EQ(nothing.panels(), 0u);
}

TEST(BlockedQr, FillsTheSquare) {
  const MatrixXd A = random_matrix(33, 33, 9), B = random_matrix(33, 1, 10);
  BlockedQr qr(33);
  EXPECT_EQ(append(qr, A, {16, 17}), 17u);
  MatrixXd x = transposed(qr, B);
  qr.solve(33, x);
  EXPECT_LE((A * x - B).cwiseAbs().maxCoeff(), 1e-10);
}

}  // namespace
}  // namespace deform::blocked_qr_test
