// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/dense/packed_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <thread>

#include "core/base/error.h"
#include "tests/core/numerics/random_points.h"

namespace deform::packed_cholesky_test {
namespace {

Eigen::MatrixXd definite(Eigen::Index n, std::uint64_t seed) {
  const auto values = test::random_values(static_cast<std::size_t>(n * n), seed);
  const Eigen::MatrixXd G = Eigen::Map<const Eigen::MatrixXd>(values.data(), n, n);
  return G * G.transpose() + Eigen::MatrixXd::Identity(n, n);
}

PackedCholesky packed(const Eigen::MatrixXd& A) {
  PackedCholesky result(static_cast<std::size_t>(A.rows()));
  for (std::size_t p = 0; p < result.panels(); ++p) {
    for (std::size_t c = 0; c < result.width(p); ++c) {
      for (std::size_t r = 0; r < result.rows(p); ++r) {
        result.panel(p)[c * result.rows(p) + r] =
            A(static_cast<Eigen::Index>(result.first(p) + r), static_cast<Eigen::Index>(result.first(p) + c));
      }
    }
  }
  return result;
}

TEST(PackedCholesky, SolvesLikeEigenAtEverySize) {
  for (const Eigen::Index n : {1, 2, 31, 32, 33, 64, 65, 200, 640, 1001}) {
    const Eigen::MatrixXd A = definite(n, 1);
    PackedCholesky factor = packed(A);
    EXPECT_NEAR(factor.norm1({}), A.cwiseAbs().colwise().sum().maxCoeff(), 1e-9);
    ASSERT_TRUE(factor.factor({}));
    const auto values = test::random_values(static_cast<std::size_t>(n * 5), 2);
    const Eigen::MatrixXd B = Eigen::Map<const Eigen::MatrixXd>(values.data(), n, 5);
    Eigen::MatrixXd X = B;
    factor.solve(X.data(), static_cast<std::size_t>(n), 5);
    const Eigen::MatrixXd expected = A.llt().solve(B);
    EXPECT_LT((A * X - B).norm(), 1e-12 * (A.norm() * X.norm() + B.norm())) << n;
    EXPECT_LT((X - expected).norm(), 1e-9 * expected.norm()) << n;
  }
}

TEST(PackedCholesky, TakesLittleMoreThanHalf) {
  for (const std::size_t n : {1000, 2000, 6000, 20000}) {
    EXPECT_LE(static_cast<double>(PackedCholesky::bytes_for(n)), 0.55 * 8.0 * static_cast<double>(n) * static_cast<double>(n));
  }
  EXPECT_EQ(PackedCholesky(777).bytes(), PackedCholesky::bytes_for(777));
}

TEST(PackedCholesky, SaysWhenTheMatrixIsNotDefinite) {
  for (const Eigen::Index bad : {0, 40, 299}) {
    Eigen::MatrixXd A = definite(300, 3);
    A(bad, bad) = -1;
    EXPECT_FALSE(packed(A).factor({}));
  }
  Eigen::MatrixXd nan = definite(100, 3);
  nan(50, 50) = std::nan("");
  EXPECT_FALSE(packed(nan).factor({}));
}

TEST(PackedCholesky, SameBitsForAnyNumberOfThreads) {
  const Eigen::MatrixXd A = definite(900, 4);
  PackedCholesky one = packed(A), two = packed(A);
  RunContext context;
  context.threads = 1;
  ASSERT_TRUE(one.factor(context));
  context.threads = 2;
  ASSERT_TRUE(two.factor(context));
  for (std::size_t p = 0; p < one.panels(); ++p) {
    EXPECT_TRUE(std::equal(one.panel(p), one.panel(p) + one.width(p) * one.rows(p), two.panel(p)));
  }
}

TEST(PackedCholesky, SolvesFromManyThreads) {
  const Eigen::MatrixXd A = definite(400, 5);
  PackedCholesky factor = packed(A);
  ASSERT_TRUE(factor.factor({}));
  const PackedCholesky& shared = factor;
  const auto values = test::random_values(400 * 3, 6);
  std::vector<double> expected = values;
  shared.solve(expected.data(), 400, 3);
  std::vector<std::vector<double>> got(4, values);
  std::vector<std::thread> threads;
  for (auto& B : got) {
    threads.emplace_back([&shared, &B] { shared.solve(B.data(), 400, 3); });
  }
  for (auto& thread : threads) thread.join();
  for (const auto& B : got) EXPECT_TRUE(B == expected);
}

TEST(PackedCholesky, StopsWhenCancelled) {
  PackedCholesky factor = packed(definite(900, 4));
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  int reports = 0;
  context.on_progress = [&](const std::string& stage, double) {
    EXPECT_EQ(stage, "factor");
    if (++reports == 3) stop.request_stop();
  };
  EXPECT_THROW(factor.factor(context), Error);
  EXPECT_EQ(reports, 3);
}

}  // namespace
}  // namespace deform::packed_cholesky_test
