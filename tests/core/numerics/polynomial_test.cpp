// SPDX-License-Identifier: GPL-3.0-or-later
// The polynomial part on centres that span less than space, and on surfaces where quadratics depend on each other.
#include "core/numerics/kernels/polynomial.h"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <cmath>

#include "tests/core/numerics/random_points.h"

namespace deform::polynomial_test {
namespace {

void expect_space(const std::vector<Vec3>& centres, int degree, int dimension, std::size_t terms, std::size_t dropped) {
  const PolynomialSpace space(centres, degree);
  EXPECT_EQ(space.hull_dimension(), dimension);
  EXPECT_EQ(space.terms(), terms);
  EXPECT_EQ(space.dropped(), dropped);
  const Eigen::MatrixXd P = space.matrix(centres);
  EXPECT_EQ(Eigen::ColPivHouseholderQR<Eigen::MatrixXd>(P).rank(), static_cast<Eigen::Index>(terms));
}

std::vector<Vec3> flattened(int dimension, double noise) {
  auto points = test::random_points(60, 1);
  const auto bumps = test::random_values(180, 2);
  // A tilted, shifted subspace, so that nothing is aligned with the axes.
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 p = points[i];
    const double u = p[0], v = dimension > 1 ? p[1] : 0, w = dimension > 2 ? p[2] : 0;
    points[i] = {3 + 0.6 * u - 0.8 * v, -2 + 0.8 * u + 0.6 * v, 1 + 0.3 * u + w};
    for (std::size_t k = 0; k < 3; ++k) points[i][k] += noise * bumps[3 * i + k];
  }
  return points;
}

TEST(Polynomial, TermsFollowTheAffineHull) {
  const std::size_t linear[] = {1, 2, 3, 4};
  const std::size_t quadratic[] = {1, 3, 6, 10};
  for (const double noise : {0.0, 1e-9}) {
    for (int d = 1; d <= 3; ++d) {
      expect_space(flattened(d, noise), 0, d, 1, 0);
      expect_space(flattened(d, noise), 1, d, linear[d], 0);
      expect_space(flattened(d, noise), 2, d, quadratic[d], 0);
    }
  }
  expect_space({{1, 2, 3}}, 1, 0, 1, 0);
  expect_space({{1, 2, 3}}, 2, 0, 1, 0);
  expect_space(std::vector<Vec3>(5, Vec3{1, 2, 3}), 1, 0, 1, 0);
}

TEST(Polynomial, ThinButNotFlatKeepsItsDimension) { EXPECT_EQ(PolynomialSpace(flattened(2, 1e-4), 1).hull_dimension(), 3); }

TEST(Polynomial, FewerCentresThanMonomials) {
  EXPECT_EQ(PolynomialSpace(test::random_points(2, 3), 1).terms(), 2u);
  EXPECT_EQ(PolynomialSpace(test::random_points(7, 3), 2).terms(), 7u);
}

TEST(Polynomial, QuadraticsOnASphereLoseOneTerm) {
  auto points = test::random_points(100, 4);
  for (Vec3& p : points) {
    Vec3 d{p[0] - 0.5, p[1] - 0.5, p[2] - 0.5};
    const double r = std::hypot(d[0], d[1], d[2]);
    for (std::size_t k = 0; k < 3; ++k) p[k] = 5 + 2 * d[k] / r;
  }
  expect_space(points, 2, 3, 9, 1);
  expect_space(points, 1, 3, 4, 0);
}

TEST(Polynomial, ConstantAcrossTheHull) {
  const auto centres = flattened(2, 0);
  const PolynomialSpace space(centres, 2);
  const auto edge = [&](std::size_t i) {
    return Vec3{centres[i][0] - centres[0][0], centres[i][1] - centres[0][1], centres[i][2] - centres[0][2]};
  };
  const Vec3 a = edge(1), b = edge(2);
  const Vec3 normal{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  const double size = std::hypot(normal[0], normal[1], normal[2]);
  std::vector<double> on(space.terms()), off(space.terms());
  space.values(centres[9], on.data());
  Vec3 moved = centres[9];
  for (std::size_t k = 0; k < 3; ++k) moved[k] += 10 * normal[k] / size;
  space.values(moved, off.data());
  for (std::size_t t = 0; t < on.size(); ++t) EXPECT_NEAR(on[t], off[t], 1e-12);
}

TEST(Polynomial, NoneAtAll) { EXPECT_EQ(PolynomialSpace(test::random_points(9, 1), -1).terms(), 0u); }

}  // namespace
}  // namespace deform::polynomial_test
