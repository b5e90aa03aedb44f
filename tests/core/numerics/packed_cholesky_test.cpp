#include "core/numerics/packed_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <thread>

#include "core/base/error.h"

namespace deform {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

MatrixXd positive_definite(Index n) {
  std::srand(7);
  const MatrixXd A = MatrixXd::Random(n, n);
  return A * A.transpose() + 0.5 * static_cast<double>(n) * MatrixXd::Identity(n, n);
}

void fill(PackedCholesky& packed, const MatrixXd& A) {
  for (std::size_t p = 0; p < packed.panels(); ++p) {
    for (std::size_t c = 0; c < packed.width(p); ++c) {
      for (std::size_t r = c; r < packed.rows(p); ++r) {  // at and below the diagonal only
        packed.panel(p)[c * packed.rows(p) + r] =
            A(static_cast<Index>(packed.first(p) + r), static_cast<Index>(packed.first(p) + c));
      }
    }
  }
}

TEST(PackedCholesky, EqualsEigenForManySizes) {
  for (const std::size_t n : {0u, 1u, 2u, 31u, 32u, 33u, 64u, 65u, 200u, 511u, 1100u}) {
    const MatrixXd A = positive_definite(static_cast<Index>(n));
    PackedCholesky packed(n);
    EXPECT_EQ(packed.bytes(), PackedCholesky::bytes_for(n));
    fill(packed, A);
    if (n > 0) {
      EXPECT_NEAR(packed.norm1({}), A.cwiseAbs().colwise().sum().maxCoeff(), 1e-12 * A.cwiseAbs().sum());
    }
    ASSERT_TRUE(packed.factor({})) << n;
    const auto rows = static_cast<Index>(n);
    MatrixXd B = MatrixXd::Random(rows + 3, 5);  // a leading dimension of its own
    const MatrixXd given = B;
    packed.solve(B.data(), n + 3, 5);
    const MatrixXd expected = A.llt().solve(given.topRows(rows));
    if (n > 0) {
      EXPECT_LT((B.topRows(rows) - expected).cwiseAbs().maxCoeff(), 1e-12) << n;
    }
    EXPECT_TRUE(B.bottomRows(3) == given.bottomRows(3));
  }
}

TEST(PackedCholesky, NotPositiveDefinite) {
  for (const Index n : {1, 33, 300}) {
    MatrixXd A = positive_definite(n);
    A(n - 1, n - 1) = -1;
    PackedCholesky packed(static_cast<std::size_t>(n));
    fill(packed, A);
    EXPECT_FALSE(packed.factor({})) << n;
  }
}

TEST(PackedCholesky, SameBitsForAnyNumberOfThreads) {
  const MatrixXd A = positive_definite(700);
  std::vector<PackedCholesky> factors;
  for (const int threads : {1, 2, 0}) {
    RunContext context;
    context.threads = threads;
    factors.emplace_back(700);
    fill(factors.back(), A);
    ASSERT_TRUE(factors.back().factor(context));
  }
  for (std::size_t p = 0; p < factors[0].panels(); ++p) {
    const std::size_t rows = factors[0].rows(p);
    for (std::size_t c = 0; c < factors[0].width(p); ++c) {
      for (std::size_t r = c; r < rows; ++r) {
        ASSERT_EQ(factors[0].panel(p)[c * rows + r], factors[1].panel(p)[c * rows + r]);
        ASSERT_EQ(factors[0].panel(p)[c * rows + r], factors[2].panel(p)[c * rows + r]);
      }
    }
  }
}

TEST(PackedCholesky, ManyThreadsSolveAtOnce) {
  constexpr std::size_t n = 300;
  PackedCholesky packed(n);
  fill(packed, positive_definite(n));
  ASSERT_TRUE(packed.factor({}));
  const MatrixXd B = MatrixXd::Random(n, 3);
  MatrixXd expected = B;
  packed.solve(expected.data(), n, 3);
  std::vector<MatrixXd> results(8, B);
  std::vector<std::thread> threads;
  for (MatrixXd& result : results) threads.emplace_back([&] { packed.solve(result.data(), n, 3); });
  for (std::thread& thread : threads) thread.join();
  for (const MatrixXd& result : results) EXPECT_TRUE(result == expected);
}

TEST(PackedCholesky, StopsWhenTold) {
  PackedCholesky packed(500);
  fill(packed, positive_definite(500));
  RunContext context;
  context.cancel.emplace();
  context.on_progress = [&](const std::string&, double) { context.cancel->cancel(); };
  EXPECT_THROW(packed.factor(context), Error);
}

TEST(PackedCholesky, TakesLittleMoreThanHalfOfTheSquare) {
  for (const std::size_t n : {1000u, 3000u, 6000u, 20000u}) {
    EXPECT_LE(static_cast<double>(PackedCholesky::bytes_for(n)), 0.55 * 8 * static_cast<double>(n) * static_cast<double>(n));
  }
}

}  // namespace
}  // namespace deform
