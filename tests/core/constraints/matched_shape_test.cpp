// SPDX-License-Identifier: GPL-3.0-or-later
// Feature lines (similarity) and rigid shapes.
#include "core/constraints/matched_shape.h"

#include <cmath>

#include "tests/core/constraints/projection_checks.h"

namespace deform::matched_shape_test {
namespace {

using namespace test;

/// A bent curve in space.
Points curve() {
  Points points;
  for (int i = 0; i < 25; ++i) {
    const double t = 0.1 * i;
    points.push_back({0.3 * std::cos(t), 0.3 * std::sin(2 * t), 0.1 * t * t});
  }
  return points;
}

Points scaled(const Points& x, double factor) {
  Points result = x;
  for (Vec3& p : result) {
    for (double& c : p) c *= factor;
  }
  return result;
}

TEST(Rigid, IsTheProjection) { expect_projection(*matched_projection(curve(), Match::rigid), moved(curve(), tilted(2.5)), 0.02); }

TEST(FeatureLine, IsTheProjection) {
  expect_projection(*matched_projection(curve(), Match::similar), moved(scaled(curve(), 1.7), tilted(2.5)), 0.02);
}

TEST(Rigid, DoesNotScale) {
  const Projected p = projected(*matched_projection(curve(), Match::rigid), scaled(curve(), 2));
  EXPECT_GT(p.energy, 0.1);
  // Distances are those at rest.
  for (std::size_t i = 1; i < 25; ++i) {
    const auto rest = curve();
    EXPECT_NEAR(std::hypot(p.points[i][0] - p.points[0][0], p.points[i][1] - p.points[0][1], p.points[i][2] - p.points[0][2]),
                std::hypot(rest[i][0] - rest[0][0], rest[i][1] - rest[0][1], rest[i][2] - rest[0][2]), 1e-14);
  }
}

TEST(Rigid, NeverMirrors) {
  Points mirrored = curve();
  for (Vec3& p : mirrored) p[0] = -p[0];
  for (const Match match : {Match::rigid, Match::similar}) {
    const auto shape = matched_projection(curve(), match);
    const Projected p = projected(*shape, mirrored);
    EXPECT_GT(p.energy, 1e-3);
    // The volume of four points keeps its sign.
    const auto volume = [](const Points& x) {
      Eigen::Matrix3d M;
      for (int k = 0; k < 3; ++k) {
        for (int c = 0; c < 3; ++c) M(c, k) = x[8 * (static_cast<std::size_t>(k) + 1)][c] - x[0][c];
      }
      return M.determinant();
    };
    EXPECT_GT(volume(p.points) * volume(curve()), 0);
    expect_nearest(*shape, mirrored, 1e-9);
  }
}

TEST(Rigid, DegenerateSets) {
  Points line;
  for (int i = 0; i < 25; ++i) line.push_back({0.1 * i, 0.2 * i, 0});
  for (const Match match : {Match::rigid, Match::similar}) {
    for (const Points& rest : {curve(), line, Points(25, Vec3{1, 2, 3})}) {
      const auto shape = matched_projection(rest, match);
      expect_unmoved(*shape, moved(rest, tilted()), 1e-12);
      for (const Points& x : {Points(25, Vec3{0.1, 0.2, 0.3}), line, curve()}) expect_survives(*shape, x);
    }
  }
  // A straight feature line stays straight and may grow.
  expect_derivative(*matched_projection(line, Match::similar), noisy(scaled(line, 1.2), 0.01, 2));
}

}  // namespace
}  // namespace deform::matched_shape_test
