// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sparse/sparse_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <thread>

#include "tests/core/numerics/random_points.h"
#include "tests/support/expect_error.h"

namespace deform::sparse_cholesky_test {
namespace {

/// Lower triangle of a grid Laplacian on n x n points plus `shift` on the diagonal, and some far-away couplings.
SparseMatrix grid(std::int64_t n, double shift) {
  std::vector<Eigen::Triplet<double, std::int64_t>> entries;
  const auto couple = [&](std::int64_t a, std::int64_t b, double weight) {
    entries.emplace_back(std::max(a, b), std::min(a, b), -weight);
    entries.emplace_back(a, a, weight);
    entries.emplace_back(b, b, weight);
  };
  for (std::int64_t i = 0; i < n * n; ++i) {
    entries.emplace_back(i, i, shift);
    if (i % n + 1 < n) couple(i, i + 1, 1 + 0.1 * std::sin(static_cast<double>(i)));
    if (i + n < n * n) couple(i, i + n, 1);
    if (i % 7 == 3) couple(i, (i * i) % (n * n) == i ? 0 : (i * i) % (n * n), 0.3);
  }
  SparseMatrix lower(n * n, n * n);
  lower.setFromTriplets(entries.begin(), entries.end());
  return lower;
}

Eigen::MatrixXd dense(const SparseMatrix& lower) {
  const SparseMatrix full = lower.selfadjointView<Eigen::Lower>();
  return Eigen::MatrixXd(full);
}

Eigen::MatrixXd right_sides(Eigen::Index n, Eigen::Index columns, std::uint64_t seed) {
  const auto values = test::random_values(static_cast<std::size_t>(n * columns), seed);
  return Eigen::Map<const Eigen::MatrixXd>(values.data(), n, columns);
}

TEST(SparseCholesky, SolvesLikeADenseFactor) {
  for (const std::int64_t n : {1, 2, 5, 20}) {
    const SparseMatrix lower = grid(n, 0.01);
    const SparseCholesky factor(lower);
    EXPECT_EQ(factor.size(), static_cast<std::size_t>(n * n));
    const Eigen::MatrixXd B = right_sides(n * n, 5, 3);
    const Eigen::MatrixXd expected = dense(lower).llt().solve(B);
    EXPECT_LT((factor.solve(B) - expected).cwiseAbs().maxCoeff(), 1e-11 * expected.cwiseAbs().maxCoeff());
    EXPECT_GT(factor.reciprocal_condition(), 1e-5);
    EXPECT_LE(factor.reciprocal_condition(), 1);
  }
}

TEST(SparseCholesky, OnlyTheLowerTriangleIsRead) {
  const SparseMatrix lower = grid(8, 0.1);
  SparseMatrix full = lower.selfadjointView<Eigen::Lower>();
  for (std::int64_t c = 0; c < full.outerSize(); ++c) {
    for (SparseMatrix::InnerIterator it(full, c); it; ++it) {
      if (it.row() < it.col()) it.valueRef() = 1e9;
    }
  }
  const Eigen::MatrixXd B = right_sides(64, 2, 4);
  EXPECT_LT((SparseCholesky(full).solve(B) - SparseCholesky(lower).solve(B)).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(SparseCholesky, ColumnsDoNotDependOnEachOther) {
  const SparseCholesky factor(grid(30, 0.01));
  const Eigen::MatrixXd B = right_sides(900, 7, 5);
  const Eigen::MatrixXd together = factor.solve(B);
  for (Eigen::Index c = 0; c < B.cols(); ++c) EXPECT_TRUE((factor.solve(B.col(c)).array() == together.col(c).array()).all());
}

TEST(SparseCholesky, IndefiniteMatricesAreRefusedByColumn) {
  SparseMatrix lower(3, 3);
  lower.insert(0, 0) = 1;
  lower.insert(1, 1) = -2;
  lower.insert(2, 2) = 1;
  lower.makeCompressed();
  test::expect_error(ErrorCode::numerical_failure, {"not positive definite", "column 1 of 3"}, [&] { SparseCholesky{lower}; });
  test::expect_error(ErrorCode::numerical_failure, {"not positive definite"}, [&] { SparseCholesky{grid(40, -0.5)}; });
}

TEST(SparseCholesky, RefusesAnOrderOfOtherLength) {
  const std::int64_t order[] = {1, 0};
  test::expect_error(ErrorCode::internal, {"order must name every row"}, [&] { SparseCholesky(grid(3, 1), order); });
}

TEST(SparseCholesky, AnEmptyMatrixHasNothingToSolve) {
  const SparseCholesky factor((SparseMatrix(0, 0)));
  EXPECT_EQ(factor.size(), 0u);
  EXPECT_EQ(factor.solve(Eigen::MatrixXd(0, 3)).cols(), 3);
}

TEST(SparseCholesky, EstimateIsWhatIsTaken) {
  const SparseMatrix lower = grid(60, 0.01);
  const SparseCholesky::Estimate estimate = SparseCholesky::estimate(lower);
  const SparseCholesky factor(lower);
  EXPECT_NEAR(static_cast<double>(estimate.factor_bytes), static_cast<double>(factor.bytes()),
              0.05 * static_cast<double>(factor.bytes()));
  EXPECT_GE(estimate.peak_bytes, factor.bytes());
  EXPECT_GT(estimate.flops, 60.0 * 60 * 60);
}

TEST(SparseCholesky, ManyThreadsSolveAtOnce) {
  const SparseCholesky factor(grid(40, 0.01));
  const Eigen::MatrixXd B = right_sides(1600, 3, 8);
  const Eigen::MatrixXd expected = factor.solve(B);
  std::vector<int> equal(6);
  std::vector<std::thread> threads;
  for (int& result : equal) {
    threads.emplace_back([&] {
      bool same = true;
      for (int i = 0; i < 20; ++i) same = same && (factor.solve(B).array() == expected.array()).all();
      result = same ? 1 : 0;
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const int result : equal) EXPECT_EQ(result, 1);
}

TEST(SparseCholesky, StopsWhenTold) {
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  test::expect_error(ErrorCode::cancelled, {}, [&] { SparseCholesky(grid(10, 1), context); });
}

}  // namespace
}  // namespace deform::sparse_cholesky_test
