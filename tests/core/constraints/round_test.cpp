// SPDX-License-Identifier: GPL-3.0-or-later
// Circles, cylinders and spheres: geometric fits with free and with kept radius.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/base/vectors.h"
#include "core/constraints/circle.h"
#include "core/constraints/cylinder.h"
#include "core/constraints/fit_starts.h"
#include "core/constraints/sections.h"
#include "core/constraints/sphere.h"
#include "tests/core/constraints/projection_checks.h"

namespace deform::round_test {
namespace {

using namespace test;

constexpr double degree = M_PI / 180;

Points arc(double radius, double angle, int count) {
  Points points;
  for (int i = 0; i < count; ++i) {
    const double t = angle * i / count;
    points.push_back({radius * std::cos(t), radius * std::sin(t), 0});
  }
  return moved(points, tilted());
}

Points tube(double radius, double angle, double length, int around = 12, int along = 7) {
  Points points;
  for (int j = 0; j < along; ++j) {
    for (int i = 0; i < around; ++i) {
      const double t = angle * (i + 0.1 * j) / around;
      points.push_back({radius * std::cos(t), radius * std::sin(t), length * j / along});
    }
  }
  return moved(points, tilted());
}

Points ball(double radius, double angle, int count = 80) {
  Points points;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - (1 - std::cos(angle)) * (i + 0.5) / count, r = std::sqrt(1 - z * z);
    points.push_back({radius * r * std::cos(2.4 * i), radius * r * std::sin(2.4 * i), radius * z});
  }
  return moved(points, tilted());
}

double mean_distance(const Points& x, const Vec3& centre) {
  double sum = 0;
  for (const Vec3& p : x) sum += std::hypot(p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]);
  return sum / static_cast<double>(x.size());
}

TEST(Circle, IsTheProjection) {
  for (const double angle : {360.0, 180.0, 60.0}) {
    SCOPED_TRACE(angle);
    expect_projection(*circle_projection(40), arc(0.3, angle * degree, 40), 0.003);
  }
}

TEST(Circle, ShortArcs) {
  // 20 degrees: the sagitta is 1.5 % of the radius. Noise well below it.
  expect_projection(*circle_projection(40), arc(0.5, 20 * degree, 40), 2e-4);
  EXPECT_NEAR(circle_curvature(arc(0.5, 20 * degree, 40)), 2, 1e-9);
}

TEST(Circle, PlaneAndCircleTogether) {
  // Noise out of the plane and in it of the size of the radius: a circle in the plane that fits best is not the nearest circle.
  const Points x = noisy(arc(0.3, 2 * M_PI, 15), 0.1, 21);
  const auto circle = circle_projection(15);
  expect_nearest(*circle, x);
  // Brute force: many starts, all parameters.
  const double energy = projected(*circle, x).energy;
  for (std::uint64_t k = 0; k < 60; ++k) {
    const Points other = noisy(arc(0.3, 2 * M_PI, 15), 0.3, 1000 + k);
    const Points competitor = projected(*circle, x, projected(*circle, other).shape).points;
    EXPECT_GE(squared(x, competitor), energy * (1 - 1e-9));
  }
}

TEST(Circle, KeptRadius) {
  const auto circle = circle_projection(40, 1 / 0.25);
  expect_projection(*circle, arc(0.25, 360 * degree, 40), 0.003);
  expect_projection(*circle, arc(0.25, 70 * degree, 40), 0.003);
  // A larger ring shrinks to the radius that is kept, about the same centre.
  const Projected p = projected(*circle, arc(0.3, 360 * degree, 40));
  EXPECT_NEAR(p.energy, 40 * 0.05 * 0.05, 1e-12);
  EXPECT_NEAR(mean_distance(p.points, {0.3, -0.2, 0.4}), 0.25, 1e-12);
}

TEST(Cylinder, IsTheProjection) {
  for (const double angle : {360.0, 180.0, 70.0}) {
    for (const double length : {0.05, 0.4, 2.0}) {
      SCOPED_TRACE(std::string("angle ") + std::to_string(angle) + " length " + std::to_string(length));
      expect_projection(*cylinder_projection(84), tube(0.3, angle * degree, length), 0.002);
    }
  }
}

// Two of the rings must stay flat and across the axis.
TEST(Cylinder, WithSectionsIsTheProjection) {
  Section first, fourth;
  for (std::uint32_t i = 0; i < 12; ++i) {
    first.push_back(i);
    fourth.push_back(36 + i);
  }
  for (const std::optional<double> curvature : {std::optional<double>(), std::optional<double>(1 / 0.3)}) {
    const auto cylinder = cylinder_projection(84, curvature);
    const auto* with = dynamic_cast<const WithSections*>(cylinder.get());
    ASSERT_NE(with, nullptr);
    EXPECT_EQ(with->kept_curvature(), curvature);
    expect_projection(*with->with_sections({first, fourth}, {}), tube(0.3, 360 * degree, 0.4), 0.002);
  }
  // Sections that keep their radius; a fit of before may have another one.
  const auto cylinder = cylinder_projection(84, {});
  const auto with = dynamic_cast<const WithSections&>(*cylinder).with_sections({first, fourth}, 1 / 0.29);
  expect_projection(*with, tube(0.29, 360 * degree, 0.4), 0.002);
  const Points x = tube(0.3, 360 * degree, 0.4);
  Points y(x.size());
  ShapeParameters shape;
  cylinder->project(x, y, shape);
  with->project(x, y, shape);
  for (std::size_t i = 0; i < x.size(); ++i) EXPECT_NEAR(deform::distance(x[i], y[i]), 0.01, 1e-12) << i;
}

TEST(Directions, NormalsAreNormal) {
  std::vector<Eigen::Vector3d> all;
  for (int k = 0; k < 3; ++k) {
    for (const double sign : {1.0, -1.0}) all.push_back(sign * Eigen::Vector3d::Unit(k));
  }
  for (const Vec3& n : normal_noise(50, 4)) all.push_back(Eigen::Vector3d(n[0], n[1], n[2]).normalized());
  for (const Eigen::Vector3d& n : all) {
    EXPECT_NEAR(any_normal_to(n).norm(), 1, 1e-14) << n.transpose();
    EXPECT_NEAR(any_normal_to(n).dot(n), 0, 1e-14) << n.transpose();
    const Eigen::Matrix3d along = axes_from(n, n), across = axes_from(n, any_normal_to(n));
    for (const Eigen::Matrix3d& axes : {along, across}) {
      EXPECT_LT((axes.transpose() * axes - Eigen::Matrix3d::Identity()).norm(), 1e-13);
      EXPECT_NEAR(axes.determinant(), 1, 1e-13);
      EXPECT_LT((axes.col(2) - n).norm(), 1e-14);
    }
    EXPECT_LT((across.col(0) - any_normal_to(n)).norm(), 1e-13);
  }
}

// Starts of the search for an axis: none is far from all of them, and the principal axes are among them.
TEST(Directions, AreAllAround) {
  PrincipalAxes axes;
  axes.axes.setIdentity();
  const std::vector<Eigen::Vector3d> all = directions(50, axes);
  ASSERT_EQ(all.size(), 53u);
  for (const Eigen::Vector3d& d : all) EXPECT_NEAR(d.norm(), 1, 1e-14);
  for (int k = 0; k < 3; ++k) EXPECT_EQ(all[static_cast<std::size_t>(50 + k)], Eigen::Vector3d::Unit(k));
  for (const Vec3& wanted : normal_noise(500, 9)) {
    const Eigen::Vector3d w = Eigen::Vector3d(wanted[0], wanted[1], wanted[2]).normalized();
    double nearest = 0;
    for (const Eigen::Vector3d& d : all) nearest = std::max(nearest, std::abs(d.dot(w)));
    EXPECT_GT(nearest, std::cos(25 * degree)) << "50 caps of 11.5 degrees cover half a sphere, if they could";
  }
}

/// The smallest of the squared distances and the closest direction among candidates of the search for the axis of `x`.
void expect_axis_among_candidates(const Points& x, Profile profile, double slope, double radius) {
  const Eigen::Vector3d axis = tilted().linear() * Eigen::Vector3d::UnitZ(), origin = tilted().translation();
  const std::vector<AxisCandidate> found = axis_candidates(x, profile, 3);
  ASSERT_FALSE(found.empty());
  EXPECT_LE(found.size(), 3u);
  for (std::size_t i = 1; i < found.size(); ++i) {
    EXPECT_GE(found[i].energy, found[i - 1].energy);
    for (std::size_t k = 0; k < i; ++k) {
      EXPECT_LT(std::abs(found[i].direction.dot(found[k].direction)), std::cos(20 * degree) + 1e-12);
    }
  }
  const AxisCandidate& best = found[0];
  const double sign = best.direction.dot(axis) < 0 ? -1 : 1;
  EXPECT_GT(sign * best.direction.dot(axis), std::cos(12 * degree)) << "as near as any of 250 directions";
  const Eigen::Vector3d off = best.point - origin;
  const double height = off.dot(axis);
  EXPECT_LE((off - height * axis).norm(), 0.2 * radius);
  EXPECT_NEAR(best.radius, radius + slope * height, 0.15 * radius);
  EXPECT_NEAR(sign * best.slope, slope, 0.1);
  EXPECT_LE(std::sqrt(best.energy), 0.12 * radius);
}

TEST(Cylinder, CandidatesAreNearTheAxis) {
  expect_axis_among_candidates(tube(0.3, 360 * degree, 1.5), Profile::cylinder, 0, 0.3);
  expect_axis_among_candidates(tube(0.3, 200 * degree, 1.5), Profile::cylinder, 0, 0.3);
  Points cone;
  for (int j = 0; j < 8; ++j) {
    for (int i = 0; i < 20; ++i) {
      const double t = 2 * M_PI * i / 20, r = 0.2 + 0.4 * 0.1 * j;
      cone.push_back({r * std::cos(t), r * std::sin(t), 0.1 * j});
    }
  }
  expect_axis_among_candidates(moved(cone, tilted()), Profile::cone, 0.4, 0.2);
}

TEST(Starts, AreExactForExactPoints) {
  std::vector<Eigen::Vector2d> flat;
  std::vector<Eigen::Vector3d> round;
  for (int i = 0; i < 7; ++i) {
    flat.emplace_back(2 + 0.4 * std::cos(0.3 * i), -1 + 0.4 * std::sin(0.3 * i));
    round.emplace_back(2 + 0.4 * std::cos(0.3 * i) * std::cos(i), -1 + 0.4 * std::sin(0.3 * i),
                       3 + 0.4 * std::cos(0.3 * i) * std::sin(i));
  }
  const PlaneCircle circle = algebraic_circle(flat);
  EXPECT_LE((circle.centre - Eigen::Vector2d(2, -1)).norm(), 1e-10);
  EXPECT_NEAR(circle.radius, 0.4, 1e-10);
  const AlgebraicSphere sphere = algebraic_sphere(round);
  EXPECT_LE((sphere.centre - Eigen::Vector3d(2, -1, 3)).norm(), 1e-10);
  EXPECT_NEAR(sphere.radius, 0.4, 1e-10);
}

TEST(Starts, CurvatureOfAPatch) {
  // z = 1/2 (a x^2 + 2 b x y + c y^2) with the least extent along z: the axes of the scatter are near those of the patch.
  Points x;
  for (int i = -10; i <= 10; ++i) {
    for (int j = -5; j <= 5; ++j) {
      const double u = 0.1 * i, v = 0.1 * j;
      x.push_back({u, v, 0.5 * (0.02 * u * u + 2 * 0.01 * u * v - 0.03 * v * v)});
    }
  }
  const Points there = moved(x, tilted());
  const PrincipalAxes axes = principal_axes(there);
  EXPECT_NEAR(axes.axes.determinant(), 1, 1e-12);
  const Eigen::Matrix2d H = patch_curvature(there, axes);
  // Independent of the frame: sum and product of the principal curvatures, up to their sign and the slope of the patch.
  EXPECT_NEAR(std::abs(H.trace()), 0.01, 1e-4);
  EXPECT_NEAR(H.determinant(), -0.02 * 0.03 - 0.01 * 0.01, 1e-5);
  Points large = x;
  for (Vec3& p : large) p = {3 * p[0], 3 * p[1], 3 * p[2]};
  EXPECT_NEAR(patch_curvature(large, principal_axes(large)).determinant(), H.determinant() / 9, 1e-5);
}

TEST(Starts, ThinnedPointsAreFewAndEven) {
  Points x;
  for (int i = 0; i < 1000; ++i) x.push_back({0.001 * i, 0, 0});
  for (const std::size_t count : {10u, 300u, 600u, 1000u, 2000u}) {
    const auto few = thinned(x, count);
    EXPECT_GE(few.size(), std::min<std::size_t>(count, 1000));
    EXPECT_LT(few.size(), 2 * count);
    for (std::size_t i = 2; i < few.size(); ++i) EXPECT_NEAR(few[i][0] - few[i - 1][0], few[1][0] - few[0][0], 1e-12);
  }
}

TEST(Cylinder, NearlyFlatPatches) {
  expect_projection(*cylinder_projection(84), tube(0.5, 20 * degree, 0.3), 1e-4);
  EXPECT_NEAR(cylinder_curvature(tube(0.5, 20 * degree, 0.3)), 2, 1e-9);
  // A sagitta of 1e-6 of the patch, and a plane.
  EXPECT_NEAR(cylinder_curvature(tube(1000, 1e-3 * degree * 57.3, 1)), 1e-3, 1e-9);
  Points flat = tube(0.5, 20 * degree, 0.3);
  for (Vec3& p : flat) p[2] = 0;
  expect_unmoved(*cylinder_projection(84), flat, 1e-11);
  expect_survives(*cylinder_projection(84), noisy(flat, 0.01, 4));
  expect_nearest(*cylinder_projection(84), noisy(flat, 0.01, 4), 1e-8);
}

// Wherever a patch is, and however short its arc, the search finds what a start from the truth finds.
TEST(Round, SearchesFindShortArcsFarAway) {
  const auto check = [](const Projection& projection, const Points& exact, double noise) {
    for (std::uint64_t seed = 0; seed < 5; ++seed) {
      const Points x = along(noisy(exact, noise, seed), 1, Points(exact.size(), Vec3{30, -20, 10})),
                   there = along(exact, 1, Points(exact.size(), Vec3{30, -20, 10}));
      const double from_truth = projected(projection, x, projected(projection, there).shape).energy;
      EXPECT_LE(projected(projection, x).energy, from_truth * (1 + 1e-6)) << projection.kind() << ", seed " << seed;
    }
  };
  for (const double angle : {20.0, 60.0}) {
    const double sagitta = 0.5 * (1 - std::cos(angle * degree / 2));
    for (const std::optional<double> curvature : {std::optional<double>(), std::optional<double>(2.0)}) {
      check(*circle_projection(40, curvature), arc(0.5, angle * degree, 40), 0.1 * sagitta);
      check(*cylinder_projection(84, curvature), tube(0.5, angle * degree, 0.3), 0.1 * sagitta);
      check(*sphere_projection(80, curvature), ball(0.5, angle * degree / 2), 0.1 * sagitta);
    }
  }
}

TEST(Cylinder, KeptRadius) {
  expect_projection(*cylinder_projection(84, 4.0), tube(0.25, 360 * degree, 0.4), 0.003);
  expect_projection(*cylinder_projection(84, 4.0), tube(0.25, 70 * degree, 0.4), 0.003);
  const Projected p = projected(*cylinder_projection(84, 4.0), tube(0.3, 360 * degree, 0.6));
  EXPECT_NEAR(p.energy, 84 * 0.05 * 0.05, 1e-12);
}

TEST(Cylinder, SearchFindsTheAxis) {
  // Strongly disturbed, from nothing, against starts from the true axis.
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Points exact = tube(0.3, 360 * degree, 0.05 + 0.05 * static_cast<double>(seed));
    const auto cylinder = cylinder_projection(84);
    const Points x = noisy(exact, 0.05, seed);
    const double from_truth = projected(*cylinder, x, projected(*cylinder, exact).shape).energy;
    EXPECT_LE(projected(*cylinder, x).energy, from_truth * (1 + 1e-9)) << "seed " << seed;
  }
}

TEST(Sphere, IsTheProjection) {
  for (const double angle : {180.0, 90.0, 30.0}) {
    SCOPED_TRACE(angle);
    expect_projection(*sphere_projection(80), ball(0.3, angle * degree), 0.002);
  }
  expect_projection(*sphere_projection(80), ball(0.5, 10 * degree), 1e-4);
  EXPECT_NEAR(sphere_curvature(ball(0.5, 10 * degree)), 2, 1e-9);
}

TEST(Sphere, KeptRadius) {
  expect_projection(*sphere_projection(80, 4.0), ball(0.25, 180 * degree), 0.003);
  expect_projection(*sphere_projection(80, 4.0), ball(0.25, 40 * degree), 0.003);
  const Projected p = projected(*sphere_projection(80, 4.0), ball(0.3, 180 * degree));
  EXPECT_NEAR(p.energy, 80 * 0.05 * 0.05, 0.02);
  EXPECT_NEAR(projected(*sphere_projection(80, 4.0), p.points).energy, 0, 1e-20);
}

TEST(Round, DegenerateSets) {
  Points line;
  for (int i = 0; i < 20; ++i) line.push_back({0.1 * i, 0.2 * i, 0.3});
  const Points point(20, Vec3{0.1, 0.2, 0.3});
  Points two = point;
  two[3] = {0.4, 0.2, 0.3};
  for (const std::optional<double> curvature : {std::optional<double>(), std::optional<double>(2.0)}) {
    for (const auto& shape : {circle_projection(20, curvature).release(), cylinder_projection(20, curvature).release(),
                              sphere_projection(20, curvature).release()}) {
      const std::unique_ptr<const Projection> owned(shape);
      SCOPED_TRACE(owned->kind());
      for (const Points& x : {line, point, two, noisy(line, 1e-9, 3)}) expect_survives(*owned, x);
      expect_unmoved(*owned, point, 1e-12);
      if (!curvature) expect_unmoved(*owned, line, 1e-11);
    }
  }
}

TEST(Round, CentreIsAmongThePoints) {
  // Every direction is nearest for a point in the centre: something finite comes back.
  Points x = arc(0.3, 2 * M_PI, 19);
  x.push_back({0.3, -0.2, 0.4});
  expect_survives(*circle_projection(20), x);
  expect_survives(*sphere_projection(20), x);
}

}  // namespace
}  // namespace deform::round_test
