// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/cages/convex_hull.h"

#include <gtest/gtest.h>

#include <random>

#include "core/base/vectors.h"
#include "tests/core/mesh/cages/cage_checks.h"
#include "tests/support/expect_error.h"

namespace deform::convex_hull_test {
namespace {

using test::expect_closed;
using test::expect_error;

/// A closed surface of one piece without handles, whose faces have all points below them (but for a step of the grid) and whose
/// corners are among the points, is the convex hull.
void expect_hull(const Points& points, const Mesh& hull) {
  expect_closed(hull);
  const MeshReport report = inspect(hull);
  EXPECT_EQ(report.components, 1u);
  EXPECT_EQ(report.points + report.faces, report.edges + 2);
  const Box box = bounding_box(points);
  const double step = std::max(box.side(box.longest_axis()), 1e-300) / (1 << 20);
  for (std::size_t c = 0; c < hull.face_points.size(); c += 3) {
    const Vec3& a = hull.points[hull.face_points[c]];
    const Vec3 normal = cross(hull.points[hull.face_points[c + 1]] - a, hull.points[hull.face_points[c + 2]] - a);
    for (const Vec3& x : points) ASSERT_LE(dot(normal, x - a), 4 * step * norm(normal)) << "face " << c / 3;
  }
  for (const Vec3& x : hull.points) {
    double nearest = 1e300;
    for (const Vec3& p : points) nearest = std::min(nearest, distance(x, p));
    ASSERT_LE(nearest, 2 * step);
  }
}

double volume(const Mesh& mesh) {
  double sum = 0;
  const auto corner = [&](std::size_t c) { return mesh.points[mesh.face_points[c]] - mesh.points[0]; };
  for (std::size_t c = 0; c < mesh.face_points.size(); c += 3) sum += dot(corner(c), cross(corner(c + 1), corner(c + 2))) / 6;
  return sum;
}

TEST(ConvexHull, HasAllPointsBelowItsFaces) {
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  for (const double size : {1e-9, 1.0, 1e9}) {
    SCOPED_TRACE(size);
    Points ball, sphere;
    for (int i = 0; i < 600; ++i) {
      const Vec3 x{normal(random), normal(random), normal(random)};
      ball.push_back({size * (x[0] + 5), size * (3 * x[1] - 2), size * x[2]});
      sphere.push_back((size / norm(x)) * x);
    }
    expect_hull(ball, convex_hull(ball));
    const Mesh round = convex_hull(sphere);
    expect_hull(sphere, round);
    EXPECT_EQ(round.point_count(), sphere.size()) << "all points of a sphere are corners";
  }
}

TEST(ConvexHull, OfPointsThatLieInPlanesWithOthers) {
  Points grid;
  for (int i = 0; i < 7; ++i) {
    for (int j = 0; j < 5; ++j) {
      for (int k = 0; k < 4; ++k) grid.push_back({0.1 * i, 0.1 * j, 0.1 * k});
    }
  }
  grid.insert(grid.end(), grid.begin(), grid.begin() + 50);  // coincident points
  const Mesh hull = convex_hull(grid);
  expect_hull(grid, hull);
  EXPECT_NEAR(volume(hull), 0.6 * 0.4 * 0.3, 1e-6);
}

TEST(ConvexHull, OfPointsWithoutVolumeIsThin) {
  Points plane, line;
  for (int i = 0; i < 20; ++i) {
    for (int j = 0; j < 20; ++j) plane.push_back({1.0 * i, 1.0 * j, 0.3 * i - 0.2 * j});
    line.push_back({2.0 * i, -1.0 * i, 0.5 * i});
  }
  for (const Points& points : {plane, line, Points{{3, 4, 5}}, Points{{1, 1, 1}, {1, 1, 1}}}) {
    const Mesh hull = convex_hull(points);
    expect_closed(hull);
    EXPECT_GT(volume(hull), 0);
    EXPECT_LT(volume(hull), 19 * 19 * 1e-4);
  }
}

TEST(ConvexHull, RefusesWhatHasNone) {
  expect_error(ErrorCode::invalid_argument, {"at least one point"}, [] { (void)convex_hull({}); });
  const Points points{{0, 0, 0}, {1, NAN, 0}};
  expect_error(ErrorCode::invalid_argument, {"point 1", "finite"}, [&] { (void)convex_hull(points); });
}

}  // namespace
}  // namespace deform::convex_hull_test
