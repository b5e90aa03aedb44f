// SPDX-License-Identifier: GPL-3.0-or-later
// Ways of affine motions against what they are by definition: arcs about an axis, screws, stretches, and their ends.
#include "core/deformers/handles/handle_ways.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/base/vectors.h"

namespace deform::handle_ways_test {
namespace {

/// x -> centre + turn by the angle about z times the stretches (x - centre) + shift
Affine about_z(double angle, const Vec3& centre, const Vec3& stretch, const Vec3& shift) {
  const double c = std::cos(angle), s = std::sin(angle);
  Affine a{c * stretch[0], -s * stretch[1], 0, 0, s * stretch[0], c * stretch[1], 0, 0, 0, 0, stretch[2], 0};
  const Vec3 to = transformed(a, centre);
  for (std::size_t k = 0; k < 3; ++k) a[4 * k + 3] = centre[k] - to[k] + shift[k];
  return a;
}

void expect_same(const Affine& a, const Affine& b, double tolerance) {
  for (std::size_t k = 0; k < 12; ++k) EXPECT_NEAR(a[k], b[k], tolerance) << k;
}

double determinant(const Affine& a) {
  const Vec3 x{a[0], a[4], a[8]}, y{a[1], a[5], a[9]}, z{a[2], a[6], a[10]};
  return dot(x, cross(y, z));
}

TEST(HandleWays, RigidMotionsGoAlongScrews) {
  const Vec3 centre{3, -2, 7};
  for (const double angle : {1e-3, 0.7, 2.0, 3.1, std::acos(-1)}) {
    for (const Vec3& shift : {Vec3{}, Vec3{0, 0, 5}}) {
      const AffineWay way(about_z(angle, centre, {1, 1, 1}, shift), {10, 20, 30});
      for (const double t : {0.0, 0.1, 0.5, 0.9, 1.0}) {
        const double turned = way.at(0.5)[4] < 0 ? -t * angle : t * angle;  // half a turn goes either way
        expect_same(way.at(t), about_z(turned, centre, {1, 1, 1}, t * shift), 1e-11);
      }
    }
  }
  // Shifted across the axis: a turn about another one.
  const AffineWay way(about_z(1, centre, {1, 1, 1}, {0.4, -0.3, 0}), {});
  const Affine half = way.at(0.5);
  EXPECT_NEAR(determinant(half), 1, 1e-14);
  const Vec3 twice = transformed(half, transformed(half, centre));
  EXPECT_NEAR(distance(twice, centre + Vec3{0.4, -0.3, 0}), 0, 1e-13);
}

TEST(HandleWays, StretchAndTurnAreApart) {
  const Vec3 centre{1, 2, 3}, stretch{2, 0.5, 1.5};
  const AffineWay way(about_z(2.5, centre, stretch, {0, 0, 1}), centre);
  for (const double t : {0.25, 0.5, 0.75, 1.0}) {
    const Vec3 part{1 + t * (stretch[0] - 1), 1 + t * (stretch[1] - 1), 1 + t * (stretch[2] - 1)};
    expect_same(way.at(t), about_z(2.5 * t, centre, part, {0, 0, t}), 1e-13);
  }
}

TEST(HandleWays, RandomMotionsNeverCollapseOnTheWay) {
  std::mt19937_64 random(9);
  std::normal_distribution<double> normal;
  int mirrored = 0;
  for (int i = 0; i < 500; ++i) {
    Affine motion;
    for (double& x : motion) x = normal(random);
    const AffineWay way(motion, {normal(random), normal(random), normal(random)});
    EXPECT_EQ(way.at(1), motion);
    expect_same(way.at(0), identity_affine, 1e-13);
    expect_same(way.at(1 - 1e-12), motion, 1e-9);
    if (determinant(motion) <= 0) {
      ++mirrored;
      for (std::size_t k = 0; k < 12; ++k) EXPECT_NEAR(way.at(0.5)[k], 0.5 * (motion[k] + identity_affine[k]), 1e-15);
      continue;
    }
    for (int k = 1; k < 20; ++k) EXPECT_GT(determinant(way.at(k / 20.0)), 0);
  }
  EXPECT_GT(mirrored, 100);
}

TEST(HandleWays, TranslationsGoStraight) {
  Affine motion = identity_affine;
  motion[3] = 4;
  motion[11] = -2;
  const AffineWay way(motion, {});
  EXPECT_EQ(way.at(0.25)[3], 1);
  EXPECT_EQ(way.at(0.25)[11], -0.5);
}

}  // namespace
}  // namespace deform::handle_ways_test
