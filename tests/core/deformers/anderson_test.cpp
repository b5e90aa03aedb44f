// SPDX-License-Identifier: GPL-3.0-or-later
// Acceleration of a linear fixed-point iteration, whose fixed point a dense solve gives.
#include "core/deformers/constrained/anderson.h"
#include "tests/support/linear_algebra.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <random>

namespace deform::anderson_test {
namespace {

std::vector<Vec3> points_from(const Eigen::VectorXd& flat) {
  std::vector<Vec3> result(static_cast<std::size_t>(flat.size()) / 3);
  for (std::size_t i = 0; i < result.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) result[i][k] = flat[static_cast<Eigen::Index>(3 * i + k)];
  }
  return result;
}

Eigen::VectorXd flat(const std::vector<Vec3>& points) {
  Eigen::VectorXd result(static_cast<Eigen::Index>(3 * points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) result[static_cast<Eigen::Index>(3 * i + k)] = points[i][k];
  }
  return result;
}

/// q(p) = M p + b, where M shrinks everything to between 0.5 and `slowest`.
struct Iteration {
  Eigen::MatrixXd M;
  Eigen::VectorXd b;

  Iteration(Eigen::Index size, double slowest, unsigned seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> any(-1, 1);
    Eigen::MatrixXd A(size, size);
    for (double& value : A.reshaped()) value = any(random);
    const Eigen::MatrixXd Q = test::thin_svd(A).U;
    M = Q * Eigen::VectorXd::LinSpaced(size, 0.5, slowest).asDiagonal() * Q.transpose();
    b.resize(size);
    for (double& value : b) value = any(random);
  }
  std::vector<Vec3> operator()(const std::vector<Vec3>& p) const { return points_from(M * flat(p) + b); }
  Eigen::VectorXd fixed_point() const { return test::lu_solution(Eigen::MatrixXd::Identity(M.rows(), M.cols()) - M, b); }
};

/// The error after so many accelerated steps from p.
double error_after(const Iteration& q, Anderson& window, std::vector<Vec3> p, int steps) {
  for (int step = 0; step < steps; ++step) {
    const std::vector<Vec3> next = q(p);
    window.add(p, next);
    p = window.size() > 0 ? window.next() : next;
  }
  return (flat(p) - q.fixed_point()).norm();
}

// As many independent changes as unknowns determine the fixed point.
TEST(Anderson, ReachesTheFixedPointOfALinearIteration) {
  const Iteration q(3, 0.999, 2);
  Anderson window;
  const std::vector<Vec3> start(1, Vec3{4, -3, 2});
  EXPECT_LT(error_after(q, window, start, 4), 1e-9 * q.fixed_point().norm());
  EXPECT_GT((flat(q(q(q(q(start))))) - q.fixed_point()).norm(), 1e-3 * q.fixed_point().norm()) << "the plain iteration is slow";
}

// The window keeps the last five changes: more unknowns take more rounds, still far fewer than the plain iteration.
TEST(Anderson, KeepsTheLastChangesOnly) {
  const Iteration q(30, 0.99, 3);
  Anderson window;
  const std::vector<Vec3> start(10, Vec3{4, -3, 2});
  const double accelerated = error_after(q, window, start, 60);
  EXPECT_EQ(window.size(), Anderson::window);
  std::vector<Vec3> plain = start;
  for (int step = 0; step < 60; ++step) plain = q(plain);
  EXPECT_LT(accelerated, 1e-3 * (flat(plain) - q.fixed_point()).norm());
}

TEST(Anderson, StartsAfreshWhenCleared) {
  const Iteration other(6, 0.9, 4), q(6, 0.95, 5);
  Anderson used, fresh;
  error_after(other, used, std::vector<Vec3>(2, Vec3{1, 2, 3}), 4);
  used.clear();
  EXPECT_EQ(used.size(), 0u);
  const std::vector<Vec3> start{{1, 0, 0}, {0, 2, 0}}, second = q(start), third = q(second);
  EXPECT_EQ(used.add(start, second), 0) << "nothing has changed yet";
  fresh.add(start, second);
  EXPECT_EQ(used.add(second, third), fresh.add(second, third));
  EXPECT_EQ(used.next(), fresh.next());
}

// The rate that is reported is that of the slowest change in the window.
TEST(Anderson, EstimatesTheRateOfTheIteration) {
  const Iteration q(3, 0.9, 6);
  const Eigen::VectorXd slow = test::thin_svd(q.M).V.col(0), fast = test::thin_svd(q.M).V.col(2);
  Anderson window;
  Eigen::VectorXd p = Eigen::VectorXd::Zero(3);
  const auto add = [&] { return window.add(points_from(p), q(points_from(p))); };
  EXPECT_EQ(add(), 0);
  p += slow;
  EXPECT_NEAR(add(), 0.9, 1e-12);
  for (std::size_t i = 0; i < Anderson::window - 1; ++i) {
    p += fast;
    EXPECT_NEAR(add(), 0.9, 1e-12);
  }
  p += fast;
  EXPECT_NEAR(add(), 0.5, 1e-12) << "the slow change has left the window";
  EXPECT_NEAR(add(), 0.5, 1e-12) << "no change at all says nothing";
  EXPECT_EQ(window.size(), Anderson::window);
}

}  // namespace
}  // namespace deform::anderson_test
