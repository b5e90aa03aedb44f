// SPDX-License-Identifier: GPL-3.0-or-later
// Conjugate gradients against a dense solve, and how they end.
#include "core/numerics/sparse/conjugate_gradients.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "core/base/error.h"

namespace deform::conjugate_gradients_test {
namespace {

using Eigen::MatrixXd;

MatrixXd positive_definite(Eigen::Index size) {
  std::srand(1);
  const MatrixXd A = MatrixXd::Random(size, size);
  return A * A.transpose() + MatrixXd::Identity(size, size);
}

const auto diagonal_of = [](const MatrixXd& A) {
  return [&A](const MatrixXd& r) -> MatrixXd { return A.diagonal().cwiseInverse().asDiagonal() * r; };
};

TEST(ConjugateGradients, EqualADenseSolveOfAllColumnsAtOnce) {
  const MatrixXd A = positive_definite(30), b = MatrixXd::Random(30, 3);
  const auto product = [&](const MatrixXd& p) -> MatrixXd { return A * p; };
  const auto result = conjugate_gradients(b, product, diagonal_of(A), 1e-13, 1000, {});
  EXPECT_EQ(result.end, GradientsEnd::converged);
  EXPECT_LT((result.x - A.llt().solve(b)).norm(), 1e-10 * result.x.norm());
  const auto exact = [&](const MatrixXd& r) -> MatrixXd { return A.llt().solve(r); };
  EXPECT_EQ(conjugate_gradients(b, product, exact, 1e-10, 1000, {}).iterations, 1);
  EXPECT_EQ(conjugate_gradients(MatrixXd(0 * b), product, exact, 1e-10, 1000, {}).iterations, 0);
}

TEST(ConjugateGradients, SayWhereTheyEndedEarly) {
  const MatrixXd A = positive_definite(30), b = MatrixXd::Random(30, 1);
  const auto product = [&](const MatrixXd& p) -> MatrixXd { return A * p; };
  const auto few = conjugate_gradients(b, product, diagonal_of(A), 1e-13, 3, {});
  EXPECT_EQ(few.end, GradientsEnd::limit);
  EXPECT_EQ(few.iterations, 3);
  EXPECT_LT((A * few.x - b).norm(), b.norm());
  const auto negative = [&](const MatrixXd& p) -> MatrixXd { return -p; };
  const auto none = conjugate_gradients(b, negative, diagonal_of(A), 1e-13, 10, {});
  EXPECT_EQ(none.end, GradientsEnd::indefinite);
  EXPECT_EQ(none.iterations, 0);
  EXPECT_TRUE(none.x.isZero(0));
  RunContext cancelled;
  std::stop_source stop;
  cancelled.stop = stop.get_token();
  stop.request_stop();
  EXPECT_THROW(conjugate_gradients(b, product, diagonal_of(A), 1e-13, 10, cancelled), Error);
}

}  // namespace
}  // namespace deform::conjugate_gradients_test
