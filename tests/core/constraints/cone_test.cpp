// SPDX-License-Identifier: GPL-3.0-or-later
// Cones: geometric fits with free and with kept angle, the apex, and the limits cylinder and plane.
#include "core/constraints/cone.h"

#include <cmath>

#include "tests/core/constraints/projection_checks.h"

namespace deform::cone_test {
namespace {

using namespace test;

constexpr double degree = M_PI / 180;

struct Patch {
  double half_angle = 0;      ///< half the opening, degrees
  double from = 0.2, to = 1;  ///< distance from the apex
  double around = 360;        ///< degrees
};

Points cone(const Patch& patch, int count = 96) {
  Points points;
  const int rings = 8, each = count / rings;
  const double slope = patch.half_angle * degree;
  for (int j = 0; j < rings; ++j) {
    for (int i = 0; i < each; ++i) {
      const double t = patch.around * degree * (i + 0.1 * j) / each;
      const double l = patch.from + (patch.to - patch.from) * j / (rings - 1);
      points.push_back({l * std::sin(slope) * std::cos(t), l * std::sin(slope) * std::sin(t), l * std::cos(slope)});
    }
  }
  return moved(points, tilted());
}

TEST(Cone, IsTheProjection) {
  for (const Patch& patch : {Patch{20, 0.2, 1}, Patch{45, 0.3, 0.6}, Patch{10, 0.5, 1, 120}, Patch{60, 0.2, 0.5, 200}}) {
    SCOPED_TRACE(std::to_string(patch.half_angle));
    expect_projection(*cone_projection(96), cone(patch), 0.001);
    EXPECT_NEAR(cone_angle(cone(patch)), patch.half_angle * degree, 1e-9);
  }
}

TEST(Cone, ShortArcs) {
  const Patch patch{30, 0.4, 0.8, 40};
  expect_unmoved(*cone_projection(96), cone(patch));
  const Points x = noisy(cone(patch), 1e-4, 3);
  expect_nearest(*cone_projection(96), x);
  expect_derivative(*cone_projection(96), x);
  expect_same_from_any_start(*cone_projection(96), x, 1e-8);
}

TEST(Cone, KeptAngle) {
  expect_projection(*cone_projection(96, 30 * degree), cone({30, 0.2, 1}), 0.001);
  const auto kept = cone_projection(96, 25 * degree);
  const Points x = cone({30, 0.2, 1});
  EXPECT_GT(projected(*kept, x).energy, 1e-3);
  expect_nearest(*kept, x);
  expect_derivative(*kept, x);
  EXPECT_NEAR(cone_angle(projected(*kept, x).points), 25 * degree, 1e-9);
}

TEST(Cone, BeyondTheApexTheApexIsNearest) {
  Points x = cone({30, 0.05, 1});
  // Three points on the axis below the tip.
  for (const double z : {-0.1, -0.2, -0.05}) {
    const Points tip = moved({{0.01, 0, z}}, tilted());
    x.push_back(tip[0]);
  }
  const auto shape = cone_projection(x.size());
  const Projected p = projected(*shape, x);
  const Points& y = p.points;
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(y[96][k], y[97][k], 1e-12);
    EXPECT_NEAR(y[96][k], y[98][k], 1e-12);
  }
  // Central differences are worse so near to the apex: directions to it turn by 1 / 0.05 and more.
  expect_derivative(*shape, x, 1e-5);
  expect_linearization(*shape, x, 1e-6, 1e-6);
}

TEST(Cone, LimitsAndDegenerateSets) {
  Points cylinder, line;
  for (int i = 0; i < 60; ++i) cylinder.push_back({0.3 * std::cos(0.7 * i), 0.3 * std::sin(0.7 * i), 0.02 * i});
  for (int i = 0; i < 60; ++i) line.push_back({0.01 * i, 0.02 * i, 0.3});
  const auto shape = cone_projection(60);
  expect_unmoved(*shape, cylinder, 1e-11);
  EXPECT_NEAR(cone_angle(cylinder), 0, 1e-9);
  for (const Points& x : {cylinder, line, noisy(line, 1e-9, 1), Points(60, Vec3{0.1, 0.2, 0.3}), noisy(line, 0.1, 2)}) {
    expect_survives(*shape, x);
    expect_survives(*cone_projection(60, 0.3), x);
  }
}

}  // namespace
}  // namespace deform::cone_test
