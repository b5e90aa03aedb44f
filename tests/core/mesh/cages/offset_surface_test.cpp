// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/cages/offset_surface.h"

#include <gtest/gtest.h>

#include <random>

#include "core/base/vectors.h"
#include "core/mesh/cages/crossing_triangles.h"
#include "core/mesh/cages/mirror_frame.h"
#include "core/mesh/remeshing/isotropic_remeshing.h"
#include "core/mesh/surface_mesh/surface_mesh.h"
#include "tests/core/mesh/cages/cage_checks.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/core/mesh/remeshing/remeshing_checks.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::offset_surface_test {
namespace {

using test::expect_closed;
using test::expect_error;
using test::triangles_of;

Mesh offset_of(const Mesh& mesh, double offset, double cell) {
  return offset_surface(ClosestPoint(triangles_of(mesh)), bounding_box(mesh.points), {offset, cell});
}

std::size_t handles_of(const Mesh& mesh) {
  const MeshReport report = inspect(mesh);
  return (2 * report.components + report.edges - report.points - report.faces) / 2;
}

double area_of(const Mesh& mesh) {
  double area = 0;
  for (const auto& [a, b, c] : triangles_of(mesh)) area += length(cross(b - a, c - a)) / 2;
  return area;
}

/// A torus around the z axis, radii 1 and r.
Mesh torus(double r) {
  constexpr unsigned n = 60, m = 24;
  Mesh mesh;
  for (unsigned i = 0; i < n; ++i) {
    for (unsigned j = 0; j < m; ++j) {
      const double a = 2 * std::numbers::pi * i / n, b = 2 * std::numbers::pi * j / m;
      mesh.points.push_back({(1 + r * std::cos(b)) * std::cos(a), (1 + r * std::cos(b)) * std::sin(a), r * std::sin(b)});
      const auto id = [&](unsigned di, unsigned dj) { return (i + di) % n * m + (j + dj) % m; };
      for (const PointId p : {id(0, 0), id(1, 0), id(1, 1), id(0, 0), id(1, 1), id(0, 1)}) mesh.face_points.push_back(p);
      mesh.face_sizes.insert(mesh.face_sizes.end(), 2, 3);
    }
  }
  return mesh;
}

TEST(OffsetSurface, OfASphereIsALargerOne) {
  const Mesh made = offset_of(test::sphere(1, 5), 0.2, 0.1);
  expect_closed(made);
  EXPECT_NO_THROW(SurfaceMesh(made).check());
  EXPECT_EQ(inspect(made).components, 1u) << "and none inside";
  EXPECT_EQ(handles_of(made), 0u);
  for (const Vec3& x : made.points) ASSERT_NEAR(norm(x), 1.2, 0.01);
  EXPECT_NEAR(test::winding_of(made, {0, 0, 0}), 1, 1e-12) << "it faces outwards";
}

// In the first octant, open in three planes with all corners of the rims exactly there.
TEST(OffsetSurface, EndsInSymmetryPlanes) {
  const Mesh ball = test::sphere(1, 5);
  const Mesh whole = offset_of(ball, 0.2, 0.1);
  for (std::size_t planes = 1; planes <= 3; ++planes) {
    SCOPED_TRACE(planes);
    const Mesh part = offset_surface(ClosestPoint(triangles_of(ball)), bounding_box(ball.points), {0.2, 0.1, planes});
    const SurfaceMesh surface(part);
    surface.check();
    std::size_t rim = 0;
    for (const EdgeHandle e : surface.edges()) {
      const HalfedgeHandle h = SurfaceMesh::halfedge(e);
      const Vec3 &a = surface.point(surface.source(h)), &b = surface.point(surface.target(h));
      bool lies = false;
      for (std::size_t k = 0; k < planes; ++k) lies = lies || (a[k] == 0 && b[k] == 0);
      EXPECT_EQ(surface.is_boundary(e), lies);
      rim += lies ? 1 : 0;
    }
    EXPECT_GT(rim, 20u);
    for (const Vec3& x : part.points) {
      ASSERT_NEAR(norm(x), 1.2, 0.01);
      for (std::size_t k = 0; k < planes; ++k) ASSERT_GE(x[k], 0);
    }
    EXPECT_NEAR(area_of(part) * (1 << planes), area_of(whole), 0.01 * area_of(whole));
  }
}

// Where the surface passes a symmetry plane in a neck or a groove about as wide as the edges or narrower, the part on one side of
// it still ends in the plane, with all that it has there.
TEST(OffsetSurface, IsCutInNecksAndGroovesAfterRemeshing) {
  std::vector<Mesh> models;
  for (const double away : {1.05, 1.1, 1.18}) {
    models.push_back(test::sphere(1, 4));
    for (Vec3& x : models.back().points) x = x + Vec3{away, 0, 0};
  }
  for (const double gap : {0.16, 0.19}) models.push_back(test::part_above(test::sphere(1, 5), 0, gap));
  for (const Mesh& model : models) {
    for (const std::size_t vertices : {60u, 240u}) test::expect_cut(model, 0.2, vertices);
  }
}

TEST(OffsetSurface, KeepsHandlesThatAreWideEnough) {
  const Mesh ring = torus(0.3);
  const Mesh open = offset_of(ring, 0.1, 0.05), shut = offset_of(ring, 0.8, 0.2);
  expect_closed(open);
  expect_closed(shut);
  EXPECT_EQ(handles_of(open), 1u);
  EXPECT_EQ(handles_of(shut), 0u);
}

TEST(OffsetSurface, ClosesHolesNarrowerThanTwiceTheOffset) {
  Mesh sphere = test::sphere(1, 4);
  // Without the triangles around a pole.
  Mesh open = sphere;
  open.face_points.clear();
  open.face_sizes.clear();
  for (std::size_t c = 0; c < sphere.face_points.size(); c += 3) {
    if (sphere.points[sphere.face_points[c]][2] > 0.98) continue;
    open.face_sizes.push_back(3);
    for (std::size_t k = 0; k < 3; ++k) open.face_points.push_back(sphere.face_points[c + k]);
  }
  ASSERT_LT(open.face_count(), sphere.face_count());
  const Mesh closed = offset_of(open, 0.3, 0.1), hollow = offset_of(open, 0.1, 0.05);
  EXPECT_NEAR(test::winding_of(closed, {0, 0, 0}), 1, 1e-12);
  EXPECT_NEAR(test::winding_of(hollow, {0, 0, 0}), 0, 1e-12) << "the hole is wider than twice the offset";
  expect_closed(hollow);
}

TEST(OffsetSurface, OfASoupIsClosedAndManifold) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<TriangleCorners> soup;
  Box box;
  for (int i = 0; i < 30; ++i) {
    auto& triangle = soup.emplace_back();
    for (Vec3& x : triangle) {
      x = {uniform(random), uniform(random), uniform(random)};
      box.add(x);
    }
  }
  soup.push_back({soup[0][0], soup[0][0], soup[0][0]});
  const ClosestPoint closest(soup);
  const Mesh made = offset_surface(closest, box, {0.1, 0.05});
  expect_closed(made);
  EXPECT_NO_THROW(SurfaceMesh(made).check());
  for (const auto& triangle : soup) {
    for (const Vec3& x : triangle) ASSERT_NEAR(test::winding_of(made, x), 1, 1e-9);
  }
  for (const Vec3& x : made.points) ASSERT_NEAR(distance(x, closest(x)), 0.1, 0.05);
}

TEST(OffsetSurface, RefusesOptionsOutOfTheirLimits) {
  const Mesh sphere = test::sphere(1, 2);
  const ClosestPoint closest(triangles_of(sphere));
  const Box box = bounding_box(sphere.points);
  expect_error(ErrorCode::invalid_argument, {"offset"}, [&] { (void)offset_surface(closest, box, {0, 0.1}); });
  expect_error(ErrorCode::invalid_argument, {"cell"}, [&] { (void)offset_surface(closest, box, {0.1, 0.2}); });
  expect_error(ErrorCode::invalid_argument, {"cell", "nodes"}, [&] { (void)offset_surface(closest, box, {0.1, 1e-5}); });
  expect_error(ErrorCode::invalid_argument, {"planes", "4"}, [&] { (void)offset_surface(closest, box, {0.1, 0.1, 4}); });
  expect_error(ErrorCode::invalid_argument, {"no triangle"}, [&] { (void)offset_surface(ClosestPoint({}), box, {0.1, 0.1}); });
}

TEST(CrossingTriangles, AreCounted) {
  const Mesh sphere = test::sphere(1, 3);
  EXPECT_EQ(crossing_triangles(sphere), 0u);
  Mesh two = sphere;
  for (const Vec3& x : sphere.points) two.points.push_back({x[0] + 1.1, x[1] + 0.013, x[2] - 0.007});
  for (const PointId id : sphere.face_points) two.face_points.push_back(id + static_cast<PointId>(sphere.point_count()));
  two.face_sizes.insert(two.face_sizes.end(), sphere.face_count(), 3);
  // Triangles cross where one has corners on both sides of the other and the line of the two planes runs through both: by
  // sampling the edges of all pairs.
  const auto pierces = [&](std::size_t s, std::size_t t) {
    const auto corner = [&](std::size_t f, std::size_t k) { return two.points[two.face_points[3 * f + k % 3]]; };
    const Vec3 a = corner(t, 0), normal = cross(corner(t, 1) - a, corner(t, 2) - a);
    for (std::size_t k = 0; k < 3; ++k) {
      const double p = dot(normal, corner(s, k) - a), q = dot(normal, corner(s, k + 1) - a);
      if (!(p * q < 0)) continue;
      const Vec3 x = lerp(corner(s, k), corner(s, k + 1), p / (p - q));
      bool inside = true;
      for (std::size_t e = 0; e < 3; ++e) inside &= dot(cross(corner(t, e + 1) - corner(t, e), x - corner(t, e)), normal) > 0;
      if (inside) return true;
    }
    return false;
  };
  std::size_t crossing = 0;
  const std::size_t half = sphere.face_count();
  for (std::size_t s = 0; s < half; ++s) {
    for (std::size_t t = half; t < 2 * half; ++t) crossing += pierces(s, t) || pierces(t, s) ? 1 : 0;
  }
  EXPECT_GT(crossing, 20u);
  EXPECT_EQ(crossing_triangles(two), crossing);
  Mesh quads = test::quad_grid(1, 1);
  expect_error(ErrorCode::invalid_argument, {"face 0"}, [&] { (void)crossing_triangles(quads); });
}

}  // namespace
}  // namespace deform::offset_surface_test
