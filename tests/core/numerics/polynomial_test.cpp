#include "core/numerics/polynomial.h"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <cmath>

#include "tests/core/numerics/sample_centres.h"

namespace deform {
namespace {

using test::random_points;

Points mapped(Points points, const Affine& map) {
  for (Vec3& p : points) p = transformed(map, p);
  return points;
}

// Some plane and line in general position.
constexpr Affine to_plane{0.3, 0.5, 0, 0.1, -0.2, 0.4, 0, 0.3, 0.7, 0.1, 0, -0.2};
constexpr Affine to_line{0.3, 0, 0, 0.1, -0.2, 0, 0, 0.3, 0.7, 0, 0, -0.2};

// Largest error of the least-squares fit of f by the space over the points.
template <typename Function>
double misfit(const PolynomialSpace& space, const Points& points, const Function& f) {
  const Eigen::MatrixXd P = space.matrix(points);
  Eigen::VectorXd values(P.rows());
  for (Eigen::Index i = 0; i < P.rows(); ++i) values[i] = f(points[static_cast<std::size_t>(i)]);
  const Eigen::VectorXd c = P.colPivHouseholderQr().solve(values);
  return (P * c - values).lpNorm<Eigen::Infinity>();
}

double linear(const Vec3& p) { return 1 + 2 * p[0] - 3 * p[1] + 0.5 * p[2]; }
double quadratic(const Vec3& p) { return linear(p) + p[0] * p[1] - 2 * p[2] * p[2] + p[0] * p[0] + p[1] * p[2]; }

TEST(PolynomialSpace, InSpace) {
  const Points points = random_points(100);
  EXPECT_EQ(PolynomialSpace(points, -1).terms(), 0u);
  EXPECT_EQ(PolynomialSpace(points, 0).terms(), 1u);
  const PolynomialSpace first(points, 1), second(points, 2);
  EXPECT_EQ(first.terms(), 4u);
  EXPECT_EQ(second.terms(), 10u);
  EXPECT_EQ(first.hull_dimension(), 3);
  EXPECT_EQ(second.dropped(), 0u);
  EXPECT_LT(misfit(first, points, linear), 1e-13);
  EXPECT_LT(misfit(second, points, quadratic), 1e-13);
}

TEST(PolynomialSpace, InAPlaneOnALineAndInAPoint) {
  const Points plane = mapped(random_points(100), to_plane);
  const PolynomialSpace in_plane(plane, 1), squares(plane, 2);
  EXPECT_EQ(in_plane.hull_dimension(), 2);
  EXPECT_EQ(in_plane.terms(), 3u);
  EXPECT_EQ(squares.terms(), 6u);
  EXPECT_LT(misfit(in_plane, plane, linear), 1e-13);
  EXPECT_LT(misfit(squares, plane, quadratic), 1e-13);

  const Points line = mapped(random_points(50), to_line);
  const PolynomialSpace on_line(line, 1);
  EXPECT_EQ(on_line.hull_dimension(), 1);
  EXPECT_EQ(on_line.terms(), 2u);
  EXPECT_EQ(PolynomialSpace(line, 2).terms(), 3u);
  EXPECT_LT(misfit(on_line, line, linear), 1e-13);

  const Points point(3, Vec3{1, 2, 3});
  EXPECT_EQ(PolynomialSpace(point, 2).terms(), 1u);
  EXPECT_EQ(PolynomialSpace(point, 2).hull_dimension(), 0);
}

TEST(PolynomialSpace, ConstantAcrossAPlane) {
  const Points plane = mapped(random_points(100), to_plane);
  const PolynomialSpace space(plane, 1);
  const Vec3 u{0.3, -0.2, 0.7}, v{0.5, 0.4, 0.1};
  const Vec3 normal{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
  double at[10], beside[10];
  space.values(plane[0], at);
  space.values({plane[0][0] + normal[0], plane[0][1] + normal[1], plane[0][2] + normal[2]}, beside);
  for (std::size_t t = 0; t < space.terms(); ++t) EXPECT_NEAR(at[t], beside[t], 1e-13);
}

TEST(PolynomialSpace, NearlyFlatCentresAreFlat) {
  Points points = mapped(random_points(200), to_plane);
  const Points noise = random_points(200, 2);
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) points[i][k] += 1e-9 * (noise[i][k] - 0.5);
  }
  EXPECT_EQ(PolynomialSpace(points, 1).terms(), 3u);
  // A real thickness counts.
  for (std::size_t i = 0; i < points.size(); ++i) points[i][0] += 1e-4 * noise[i][2];
  EXPECT_EQ(PolynomialSpace(points, 1).terms(), 4u);
}

TEST(PolynomialSpace, OnASphereOneQuadraticDependsOnTheOthers) {
  Points points = random_points(300);
  for (Vec3& p : points) {
    for (double& x : p) x -= 0.5;
    const double r = std::sqrt(test::distance2(p, {}));
    p = {1 + p[0] / r, p[1] / r, p[2] / r};
  }
  const PolynomialSpace space(points, 2);
  EXPECT_EQ(space.terms(), 9u);
  EXPECT_EQ(space.dropped(), 1u);
  EXPECT_LT(misfit(space, points, quadratic), 1e-12);  // every quadratic is still there on the sphere
  EXPECT_EQ(PolynomialSpace(points, 1).terms(), 4u);
}

TEST(PolynomialSpace, FewerCentresThanMonomials) {
  EXPECT_EQ(PolynomialSpace(random_points(1), 2).terms(), 1u);
  EXPECT_EQ(PolynomialSpace(random_points(2), 1).terms(), 2u);
  EXPECT_EQ(PolynomialSpace(random_points(3), 1).terms(), 3u);
  EXPECT_LE(PolynomialSpace(random_points(7), 2).terms(), 7u);
}

TEST(PolynomialSpace, PlaceAndUnitsDoNotMatter) {
  for (const double scale : {1e-9, 1.0, 1e9}) {
    for (const double shift : {0.0, 1e3}) {
      Points points = random_points(60);
      for (Vec3& p : points) {
        for (double& x : p) x = scale * (x + shift);
      }
      EXPECT_EQ(PolynomialSpace(points, 1).terms(), 4u) << scale << " " << shift;
    }
  }
}

}  // namespace
}  // namespace deform
