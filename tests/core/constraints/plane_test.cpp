// SPDX-License-Identifier: GPL-3.0-or-later
// Plane, line and given plane: closed forms.
#include "core/constraints/plane.h"

#include <cmath>

#include "tests/core/constraints/projection_checks.h"

namespace deform::plane_test {
namespace {

using namespace test;

/// A grid of 6 x 5 in the plane z = 0, tilted.
Points flat() {
  Points grid;
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 5; ++j) grid.push_back({0.1 * i, 0.08 * j + 0.01 * i, 0});
  }
  return moved(grid, tilted());
}

Points straight() {
  Points line;
  for (int i = 0; i < 20; ++i) line.push_back({0.05 * i + 0.001 * i * i, 0, 0});
  return moved(line, tilted());
}

TEST(Plane, IsTheProjection) { expect_projection(*plane_projection(30), flat(), 0.01); }

TEST(Line, IsTheProjection) { expect_projection(*line_projection(20), straight(), 0.01); }

TEST(Plane, LeastSquaresAgainstEveryDirection) {
  const Points x = noisy(flat(), 0.05, 9);
  const double energy = projected(*plane_projection(30), x).energy;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Vec3& p : x) mean += Eigen::Vector3d(p[0], p[1], p[2]) / 30;
  double best = 1e300;
  for (int i = 0; i <= 200; ++i) {
    for (int j = 0; j < 400; ++j) {
      const double theta = M_PI / 2 * i / 200, phi = 2 * M_PI * j / 400;
      const Eigen::Vector3d n(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
      double sum = 0;
      for (const Vec3& p : x) sum += std::pow(n.dot(Eigen::Vector3d(p[0], p[1], p[2]) - mean), 2);
      best = std::min(best, sum);
    }
  }
  EXPECT_LE(energy, best);
  EXPECT_GE(energy, 0.98 * best) << "the raster is finer than that";
}

TEST(Plane, DegenerateSets) {
  const auto plane = plane_projection(20);
  const auto line = line_projection(20);
  for (const Points& x : {Points(20, Vec3{0.1, 0.2, 0.3}), straight()}) {
    expect_unmoved(*plane, x);
    expect_unmoved(*line, x);
    expect_survives(*plane, x);
    expect_survives(*line, x);
  }
  // A cube has no plane that is better than others.
  Points cube;
  for (int k = 0; k < 8; ++k) cube.push_back({k & 1 ? 1. : 0., k & 2 ? 1. : 0., k & 4 ? 1. : 0.});
  expect_survives(*plane_projection(8), cube);
  EXPECT_NEAR(projected(*plane_projection(8), cube).energy, 2, 1e-12);
}

TEST(FixedPlane, PointsSlideInIt) {
  const auto plane = fixed_plane_projection({0, 0, 0.5}, {0, 0.6, 0.8}, 30);
  const Points x = noisy(flat(), 0.1, 4);
  const Projected p = projected(*plane, x);
  for (std::size_t i = 0; i < x.size(); ++i) {
    EXPECT_NEAR(0.6 * p.points[i][1] + 0.8 * (p.points[i][2] - 0.5), 0, 1e-15);
    EXPECT_EQ(p.points[i][0], x[i][0]);
  }
  EXPECT_FALSE(plane->moves_with_its_points());
  expect_nearest(*plane, x);
  expect_derivative(*plane, x);
  expect_linearization(*plane, x, 0.1, 1e-10);
}

TEST(Plane, LargeSetsTakeLinearTime) {
  // 100,000 points: anything quadratic would not end.
  const Points x = noisy(Points(100000, Vec3{0.5, 0.5, 0.5}), 0.1, 6);
  Points image(x.size());
  const auto plane = plane_projection(x.size());
  const Projected p = projected(*plane, x);
  plane->derivative(x, p.shape, x, image);
  EXPECT_NEAR(p.energy / 1e5, 0.01, 2e-4);
}

}  // namespace
}  // namespace deform::plane_test
