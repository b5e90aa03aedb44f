// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>

#include "core/base/vectors.h"
#include "core/mesh/ahmed.h"
#include "core/mesh/inspect.h"
#include "core/mesh/remeshing/closest_point.h"
#include "core/mesh/remeshing/isotropic_remeshing.h"
#include "core/mesh/remeshing/triangles.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/core/mesh/remeshing/decimation.h"
#include "tests/core/mesh/remeshing/remeshing_checks.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::remeshing_test {
namespace {

using test::expect_closed_like;
using test::expect_count;
using test::expect_error;
using test::farthest;

/// A cube of side 1 whose faces are n x n squares in two triangles each: 12 sharp edges, 8 corners.
Mesh cube(unsigned n) {
  SurfaceMesh mesh(
      test::make_mesh({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}}, {{0, 2, 1},
                                                                                                                 {0, 3, 2},
                                                                                                                 {4, 5, 6},
                                                                                                                 {4, 6, 7},
                                                                                                                 {0, 1, 5},
                                                                                                                 {0, 5, 4},
                                                                                                                 {1, 2, 6},
                                                                                                                 {1, 6, 5},
                                                                                                                 {2, 3, 7},
                                                                                                                 {2, 7, 6},
                                                                                                                 {3, 0, 4},
                                                                                                                 {3, 4, 7}}));
  for (unsigned i = 0; i < n; ++i) {
    for (const EdgeHandle e : mesh.edges()) {
      const HalfedgeHandle h = SurfaceMesh::halfedge(e);
      mesh.split(e, 0.5 * (mesh.point(mesh.source(h)) + mesh.point(mesh.target(h))));
    }
  }
  return mesh.to_mesh();
}

/// The least distance over a fine grid of the triangle.
double sampled_distance(const TriangleCorners& t, const Vec3& x) {
  double least = 1e300;
  constexpr int n = 60;
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; i + j <= n; ++j) {
      least = std::min(least, distance(x, (1.0 / n) * (i * t[0] + j * t[1] + (n - i - j) * t[2])));
    }
  }
  return least;
}

TEST(ClosestPoint, IsNoFartherThanAnySample) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto point = [&] { return Vec3{uniform(random), uniform(random), uniform(random)}; };
  std::vector<TriangleCorners> triangles;
  for (int i = 0; i < 40; ++i) triangles.push_back({point(), point(), point()});
  triangles.push_back({triangles[0][0], triangles[1][1], triangles[1][1]});  // a segment
  const ClosestPoint closest(triangles);
  for (int i = 0; i < 100; ++i) {
    const Vec3 x = 2.0 * point();
    double brute = 1e300, sampled = 1e300;
    for (const TriangleCorners& t : triangles) {
      brute = std::min(brute, distance(x, closest_point(t, x)));
      sampled = std::min(sampled, sampled_distance(t, x));
    }
    const double found = distance(x, closest(x));
    EXPECT_NEAR(found, brute, 1e-14);
    EXPECT_LE(found, sampled + 1e-14);
    EXPECT_GE(found, sampled - 0.06) << "edges of at most 3.5, sampled at 1/60 of them";
    // With a distance that is enough, one that is as near or the nearest, in the triangle that is named.
    for (const double enough : {0.0, 0.5 * brute, 1.5 * brute, 10.0}) {
      const ClosestPoint::Found near = closest.find(x, enough);
      EXPECT_LE(distance(x, near.point), std::max(enough, brute) + 1e-14);
      EXPECT_LE(distance(near.point, closest_point(closest.triangle(near.triangle), near.point)), 1e-14);
    }
  }
}

TEST(IsotropicRemeshing, GivesASphereAnyNumberOfGoodTriangles) {
  const Mesh input = test::sphere(1, 5);
  const SurfaceMesh mesh(input);
  for (const std::size_t vertices : {50u, 300u, 1500u, 4000u}) {
    SCOPED_TRACE(vertices);
    const SurfaceMesh made = isotropic_remeshing(mesh, {.vertices = vertices});
    expect_closed_like(input, made);
    expect_count(made, vertices);
    EXPECT_GT(least_angle(made), 25);
    EXPECT_GT(mean_least_angle(made), 48);
    EXPECT_LT(farthest(made.to_mesh(), input), 1e-12) << "vertices lie on the surface";
  }
}

TEST(IsotropicRemeshing, KeepsTheEdgesAndCornersOfACube) {
  const Mesh input = cube(3);
  for (const std::size_t vertices : {100u, 600u}) {
    SCOPED_TRACE(vertices);
    const SurfaceMesh made = isotropic_remeshing(SurfaceMesh(input), {.vertices = vertices});
    expect_closed_like(input, made);
    expect_count(made, vertices);
    EXPECT_GT(least_angle(made), 15);
    // Both ways: what is cut off the cube would be farther from the result.
    EXPECT_LT(farthest(made.to_mesh(), input), 1e-12);
    EXPECT_LT(farthest(input, made.to_mesh()), 1e-12);
  }
}

// A sphere in eight parts. Whatever its size, edges along the great circles in the planes close around each part.
TEST(IsotropicRemeshing, KeepsEdgesInSymmetryPlanes) {
  const Mesh input = test::sphere(1, 5);
  for (const std::size_t planes : {1u, 3u}) {
    for (const std::size_t vertices : {60u, 500u, 3000u}) {
      SCOPED_TRACE(std::to_string(planes) + " " + std::to_string(vertices));
      const SurfaceMesh made =
          isotropic_remeshing(SurfaceMesh(input), {.vertices = vertices, .feature_degrees = 180, .planes = planes});
      expect_closed_like(input, made);
      expect_count(made, vertices);
      EXPECT_GT(least_angle(made), 15);
      for (std::size_t k = 0; k < planes; ++k) {
        double around = 0, longest = 0;
        for (const EdgeHandle e : made.edges()) {
          const HalfedgeHandle h = SurfaceMesh::halfedge(e);
          const Vec3 &a = made.point(made.source(h)), &b = made.point(made.target(h));
          ASSERT_GE(a[k] * b[k], 0) << "no edge runs through the plane";
          if (a[k] != 0 || b[k] != 0) continue;
          around += 2 * std::asin(distance(a, b) / 2);
          longest = std::max(longest, distance(a, b));
        }
        EXPECT_NEAR(around, 2 * std::numbers::pi, 0.02);
        EXPECT_GT(longest, 0.5 * std::sqrt(8 * std::numbers::pi / std::sqrt(3) / static_cast<double>(vertices)))
            << "as elsewhere";
      }
    }
  }
}

TEST(IsotropicRemeshing, RoundsWhatIsNotToStaySharp) {
  const Mesh input = cube(3);
  const SurfaceMesh made = isotropic_remeshing(SurfaceMesh(input), {.vertices = 200, .feature_degrees = 180});
  expect_closed_like(input, made);
  EXPECT_GT(farthest(input, made.to_mesh()), 0.01);
}

TEST(IsotropicRemeshing, KeepsTheBodyOfACar) {
  const Mesh input = ahmed_body({.target_points = 5000});
  for (const std::size_t vertices : {2000u, 8000u}) {
    SCOPED_TRACE(vertices);
    const SurfaceMesh made = isotropic_remeshing(SurfaceMesh(input), {.vertices = vertices});
    expect_closed_like(input, made);
    expect_count(made, vertices);
    EXPECT_GT(least_angle(made), 15);
    EXPECT_LT(farthest(input, made.to_mesh()), 0.01) << "of 1.044 m";
  }
}

TEST(IsotropicRemeshing, IsDeterministic) {
  const SurfaceMesh mesh(test::sphere(1, 3));
  const Mesh first = isotropic_remeshing(mesh, {.vertices = 200}).to_mesh(),
             second = isotropic_remeshing(mesh, {.vertices = 200}).to_mesh();
  EXPECT_EQ(first.points, second.points);
  EXPECT_EQ(first.face_points, second.face_points);
}

TEST(IsotropicRemeshing, RefusesWhatIsNotClosed) {
  const SurfaceMesh open(test::one_ring()), quads(test::quad_grid(1, 1));
  expect_error(ErrorCode::invalid_argument, {"not closed", "edge"}, [&] { (void)isotropic_remeshing(open, {}); });
  expect_error(ErrorCode::invalid_argument, {"face 0 is no triangle"}, [&] { (void)isotropic_remeshing(quads, {}); });
  const SurfaceMesh closed(test::tetrahedron());
  expect_error(ErrorCode::invalid_argument, {"vertices"}, [&] { (void)isotropic_remeshing(closed, {.vertices = 3}); });
  expect_error(ErrorCode::invalid_argument, {"feature_degrees"},
               [&] { (void)isotropic_remeshing(closed, {.feature_degrees = 181}); });
  expect_error(ErrorCode::invalid_argument, {"planes: 4", "0 to 3"}, [&] { (void)isotropic_remeshing(closed, {.planes = 4}); });
  expect_error(ErrorCode::invalid_argument, {"iterations"}, [&] { (void)isotropic_remeshing(closed, {.iterations = 0}); });
}

TEST(Decimation, RemovesWhatIsFlatFirst) {
  const Mesh input = cube(3);
  const SurfaceMesh made = decimated(SurfaceMesh(input), 8);
  expect_closed_like(input, made);
  ASSERT_EQ(made.vertex_count(), 8u);
  EXPECT_EQ(made.face_count(), 12u);
  EXPECT_LT(farthest(input, made.to_mesh()), 1e-12) << "the cube is left";
}

TEST(Decimation, MeetsTheCountAndStaysNear) {
  const Mesh input = test::sphere(1, 5);
  double before = 0;
  for (const std::size_t vertices : {2000u, 500u, 100u, 20u}) {
    SCOPED_TRACE(vertices);
    const SurfaceMesh made = decimated(SurfaceMesh(input), vertices);
    expect_closed_like(input, made);
    EXPECT_EQ(made.vertex_count(), vertices);
    const double away = farthest(input, made.to_mesh());
    EXPECT_GT(away, before);
    // A cap over an equilateral triangle of area 4 pi / (2 n) is s^2 / 6 high: 2.4 / n where all triangles are equilateral.
    EXPECT_LT(away, 4 * 2.4 / static_cast<double>(vertices));
    before = away;
  }
}

TEST(Decimation, KeepsTheBodyOfACar) {
  const Mesh input = ahmed_body({.target_points = 5000});
  const SurfaceMesh made = decimated(SurfaceMesh(input), 1000);
  expect_closed_like(input, made);
  EXPECT_EQ(made.vertex_count(), 1000u);
  EXPECT_LT(farthest(input, made.to_mesh()), 0.003) << "of 1.044 m";
}

TEST(Decimation, RefusesWhatIsNotClosed) {
  expect_error(ErrorCode::invalid_argument, {"not closed"}, [] { (void)decimated(SurfaceMesh(test::one_ring()), 4); });
  expect_error(ErrorCode::invalid_argument, {"vertices"}, [] { (void)decimated(SurfaceMesh(test::tetrahedron()), 3); });
}

TEST(Decimation, StopsWhereTheTopologyEnds) {
  const SurfaceMesh made = decimated(SurfaceMesh(test::tetrahedron()), 4);
  EXPECT_EQ(made.vertex_count(), 4u);
}

}  // namespace
}  // namespace deform::remeshing_test
