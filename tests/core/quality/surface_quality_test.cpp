// SPDX-License-Identifier: GPL-3.0-or-later
// Surfaces whose curvature, quality and jumps are known.
#include "core/quality/surface_quality.h"

#include <gtest/gtest.h>

#include <numeric>

#include "core/quality/region_jumps.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::surface_quality_test {
namespace {

using test::add_face;
using test::Faces;
using test::sheet;
using test::sphere;
using test::tube;

constexpr double pi = std::numbers::pi;

MeanCurvature curvature_of(const Mesh& mesh) { return mean_curvature(mesh, Adjacency(mesh)); }

double largest_error(const MeanCurvature& curvature, double exact) {
  double largest = 0;
  for (std::size_t i = 0; i < curvature.value.size(); ++i) {
    if (curvature.defined(i)) largest = std::max(largest, std::abs(curvature.value[i] - exact));
  }
  return largest;
}

TEST(MeanCurvature, SphereConverges) {
  constexpr double radius = 2.5;
  double before = 1;
  for (int level = 2; level <= 5; ++level) {
    const Mesh mesh = sphere(radius, level);
    const MeanCurvature curvature = curvature_of(mesh);
    const double error = largest_error(curvature, 1 / radius) * radius;
    EXPECT_LT(error, 0.6 * before) << "level " << level;
    before = error;
  }
  EXPECT_LT(before, 2e-3);
}

TEST(MeanCurvature, MixedAreasAddUp) {
  for (const Mesh& mesh : {sphere(1, 3), tube(1, 12, 5, 3, Faces::quads)}) {
    const MeanCurvature curvature = curvature_of(mesh);
    const double area = std::accumulate(curvature.area.begin(), curvature.area.end(), 0.0);
    EXPECT_NEAR(area, surface_quality(mesh).total_area, 1e-12 * area);
  }
}

// The strips of a tube turn by 2 pi / n at distances of 2 R sin(pi / n), which makes 1 / (2 R) for every n.
TEST(MeanCurvature, Tube) {
  for (const Faces faces : {Faces::quads, Faces::triangles}) {
    for (const std::uint32_t around : {8u, 40u}) {
      const Mesh mesh = tube(3, around, 6, 4, faces);
      const MeanCurvature curvature = curvature_of(mesh);
      EXPECT_LT(largest_error(curvature, 1.0 / 6), 1e-12);
      for (std::size_t i = 0; i < mesh.point_count(); ++i) {
        const bool end = i < around || i >= mesh.point_count() - around;
        EXPECT_EQ(curvature.defined(i), !end) << "the ends are boundary";
      }
      EXPECT_EQ(surface_quality(mesh).curvature_points, mesh.point_count() - 2 * around);
    }
  }
}

TEST(MeanCurvature, PlanesHaveNone) {
  for (const Faces faces : {Faces::quads, Faces::triangles}) {
    const Mesh mesh = sheet(9, 7, faces, [](std::uint32_t i, std::uint32_t j) {
      return Vec3{i + 0.3 * std::sin(7.0 * i + 3.0 * j), j + 0.3 * std::cos(5.0 * i - j), 0.25 * (i + j)};
    });
    Mesh flat = mesh;
    for (Vec3& p : flat.points) p[2] = 0.5 * p[0] - p[1];
    EXPECT_LT(largest_error(curvature_of(flat), 0), 1e-12);
  }
}

// Polygons: no corner is special, so the first corner of a face does not matter.
TEST(MeanCurvature, DoesNotDependOnTheFirstCorner) {
  Mesh mesh = sheet(6, 6, Faces::quads, [](std::uint32_t i, std::uint32_t j) {
    return Vec3{double(i), double(j), std::sin(i) * std::cos(0.5 * j)};
  });
  const MeanCurvature before = curvature_of(mesh);
  for (std::size_t c = 0; c < mesh.face_points.size(); c += 4) {
    std::rotate(mesh.face_points.begin() + c, mesh.face_points.begin() + c + 1 + c % 3, mesh.face_points.begin() + c + 4);
  }
  const MeanCurvature after = curvature_of(mesh);
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    ASSERT_EQ(before.defined(i), after.defined(i));
    if (!before.defined(i)) continue;
    EXPECT_NEAR(before.value[i], after.value[i], 1e-12);
  }
}

TEST(MeanCurvature, SurvivesBadFaces) {
  Mesh mesh = sphere(1, 2);
  const auto n = static_cast<PointId>(mesh.point_count());
  const double before = curvature_of(mesh).value[0];
  mesh.points.push_back({9, 9, 9});  // isolated
  mesh.points.push_back({5, 0, 0});  // the end of a needle without area
  mesh.points.push_back({5, 0, 0});
  mesh.points.push_back({6, 0, 0});
  add_face(mesh, {n + 1, n + 2, n + 3});
  add_face(mesh, {n + 1, n + 3});
  add_face(mesh, {n + 3});
  add_face(mesh, {n + 1, n + 1, n + 3});
  const MeanCurvature curvature = curvature_of(mesh);
  EXPECT_EQ(curvature.value[0], before);
  for (PointId i = n; i < n + 4; ++i) EXPECT_FALSE(curvature.defined(i)) << i;
  for (const double area : curvature.area) EXPECT_TRUE(std::isfinite(area));
  const SurfaceQuality q = surface_quality(mesh);
  EXPECT_EQ(q.degenerate_faces, 4u);
  EXPECT_EQ(q.degenerate, (std::vector<std::size_t>{q.faces - 4, q.faces - 3, q.faces - 2, q.faces - 1}));
  EXPECT_EQ(q.least_face_quality.value, 0);
}

TEST(SurfaceQuality, ListsTheFirstHundredDegenerateFaces) {
  for (const std::size_t count : {99u, 100u, 101u, 250u}) {
    Mesh mesh = sphere(1, 2);
    for (std::size_t i = 0; i < count; ++i) add_face(mesh, {0, 1});
    const SurfaceQuality q = surface_quality(mesh);
    EXPECT_EQ(q.degenerate_faces, count);
    ASSERT_EQ(q.degenerate.size(), std::min<std::size_t>(count, 100));
    for (std::size_t i = 0; i < q.degenerate.size(); ++i) EXPECT_EQ(q.degenerate[i], q.faces - count + i);
  }
}

TEST(SurfaceQuality, KnownFaces) {
  Mesh mesh;
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {0.5, std::sqrt(0.75), 0}, {1, 1, 0}, {0, 1, 0}, {4, 0, 0}, {0, 3, 0}};
  add_face(mesh, {0, 1, 2});     // equilateral
  add_face(mesh, {0, 1, 3, 4});  // square
  add_face(mesh, {0, 5, 6});     // 3, 4, 5: r = 1, R = 2.5
  const SurfaceQuality q = surface_quality(mesh);
  EXPECT_NEAR(q.face_quality[0], 1, 1e-15);
  EXPECT_NEAR(q.face_quality[1], 1, 1e-15);
  EXPECT_NEAR(q.face_quality[2], 0.8, 1e-15);
  EXPECT_EQ(q.least_face_quality.id, 2u);
  EXPECT_EQ(q.worst.front(), 2u);
  EXPECT_NEAR(q.average_face_quality, 2.8 / 3, 1e-15);
  EXPECT_NEAR(q.least_angle.value, std::atan(0.75) * 180 / pi, 1e-12);
  EXPECT_NEAR(q.largest_angle.value, 90, 1e-12);
  EXPECT_NEAR(q.total_area, std::sqrt(3) / 4 + 1 + 6, 1e-14);
  EXPECT_EQ(q.largest_area.id, 2u);
  EXPECT_EQ(q.least_area.id, 0u);
  EXPECT_EQ(q.histogram[16] + q.histogram[15], 1u);
  EXPECT_EQ(q.histogram[19], 2u);
  EXPECT_EQ(std::accumulate(q.angle_histogram.begin(), q.angle_histogram.end(), std::size_t{0}), 10u);
  EXPECT_EQ(q.degenerate_faces, 0u);
}

// The quality of a polygon cannot exceed that of the regular one: a hexagon pulled long, a twisted quad.
TEST(SurfaceQuality, Polygons) {
  Mesh mesh;
  for (int k = 0; k < 6; ++k) mesh.points.push_back({std::cos(k * pi / 3), std::sin(k * pi / 3), 0});
  add_face(mesh, {0, 1, 2, 3, 4, 5});
  EXPECT_NEAR(surface_quality(mesh).least_face_quality.value, 1, 1e-14);
  for (Vec3& p : mesh.points) p[0] *= 4;
  EXPECT_LT(surface_quality(mesh).least_face_quality.value, 0.5);
}

/// Six columns of quads; from column `fold` on the sheet climbs by `angle`. The first three columns of points are one region.
struct FoldedStrip {
  Mesh mesh;
  std::vector<std::uint32_t> labels;
};
FoldedStrip folded_strip(double angle, std::uint32_t fold, Faces faces) {
  FoldedStrip strip;
  strip.mesh = sheet(6, 4, faces, [&](std::uint32_t i, std::uint32_t j) {
    const double beyond = i > fold ? i - fold : 0;
    return Vec3{std::min(i, fold) + beyond * std::cos(angle), double(j), beyond * std::sin(angle)};
  });
  for (std::size_t i = 0; i < strip.mesh.point_count(); ++i) strip.labels.push_back(i % 7 <= 2 ? 7 : 0);
  return strip;
}

TEST(RegionJumps, SeesTheWholeFoldAndItsCurvature) {
  constexpr double angle = 0.4;
  for (const Faces faces : {Faces::quads, Faces::triangles}) {
    for (const std::uint32_t fold : {2u, 3u}) {  // the last points of one region or the first of the other
      const FoldedStrip strip = folded_strip(angle, fold, faces);
      const RegionJumps jumps = region_jumps(strip.mesh, strip.labels, curvature_of(strip.mesh));
      EXPECT_EQ(jumps.edges, faces == Faces::quads ? 5u : 9u) << "diagonals count";
      EXPECT_NEAR(jumps.largest_normal_jump.value, angle * 180 / pi, 1e-10);
      EXPECT_NEAR(jumps.rms_normal_jump, angle * 180 / pi, 1e-10);
      // Points on the fold: the area changes with 2 sin(angle / 2) per length, over an area of width 1.
      EXPECT_NEAR(jumps.largest_curvature_jump.value, std::sin(angle / 2), 1e-12);
      EXPECT_NEAR(jumps.rms_curvature_jump, std::sin(angle / 2), 1e-12);
      EXPECT_EQ(jumps.curvature_edges, faces == Faces::quads ? 3u : 5u) << "not those at the boundary";
    }
    const FoldedStrip away = folded_strip(angle, 5, faces);
    const RegionJumps none = region_jumps(away.mesh, away.labels, curvature_of(away.mesh));
    EXPECT_NEAR(none.largest_normal_jump.value, 0, 1e-12) << "a fold within a region is none across its border";
    EXPECT_NEAR(none.largest_curvature_jump.value, 0, 1e-12);
  }
}

// A sharp edge of the model along the border stays what it is; what the deformation adds is seen.
TEST(RegionJumps, GrowthIsNotHiddenByTheModel) {
  const FoldedStrip before = folded_strip(1.2, 2, Faces::quads), after = folded_strip(1.3, 2, Faces::quads);
  const RegionJumps was = region_jumps(before.mesh, before.labels, curvature_of(before.mesh));
  const RegionJumps is = region_jumps(after.mesh, after.labels, curvature_of(after.mesh));
  const JumpGrowth growth = jump_growth(is, was);
  EXPECT_NEAR(growth.normal.value, 0.1 * 180 / pi, 1e-10);
  EXPECT_NEAR(growth.curvature.value, std::sin(0.65) - std::sin(0.6), 1e-12);
  EXPECT_EQ(growth.normal.id % 7, 2u);
  EXPECT_EQ(jump_growth(was, is).normal.value, 0);
  RegionJumps other = was;
  other.edges = 4;
  test::expect_error(ErrorCode::invalid_argument, {"5", "4"}, [&] { jump_growth(is, other); });
}

TEST(RegionJumps, NoBorderNoJump) {
  const Mesh mesh = sphere(1, 2);
  const RegionJumps jumps = region_jumps(mesh, std::vector<std::uint32_t>(mesh.point_count(), 3), curvature_of(mesh));
  EXPECT_EQ(jumps.edges, 0u);
  EXPECT_EQ(jumps.largest_normal_jump.value, 0);
  test::expect_error(ErrorCode::invalid_argument, {"5 labels"},
                     [&] { region_jumps(mesh, std::vector<std::uint32_t>(5), curvature_of(mesh)); });
}

TEST(SurfaceQuality, SameBitsForAnyNumberOfThreads) {
  Mesh mesh = sphere(1, 6);
  for (std::size_t i = 0; i < mesh.points.size(); ++i) mesh.points[i][i % 3] += 0.003 * std::sin(static_cast<double>(i));
  RunContext one;
  one.threads = 1;
  const SurfaceQuality a = surface_quality(mesh, one), b = surface_quality(mesh);
  EXPECT_EQ(a.average_face_quality, b.average_face_quality);
  EXPECT_EQ(a.average_mean_curvature, b.average_mean_curvature);
  EXPECT_EQ(a.worst, b.worst);
  EXPECT_EQ(a.mean_curvature.value, b.mean_curvature.value);
  std::vector<std::uint32_t> labels;
  for (const Vec3& p : mesh.points) labels.push_back(p[0] > 0 ? 1 : p[1] > 0 ? 2 : 3);
  const RegionJumps x = region_jumps(mesh, labels, a.mean_curvature, one), y = region_jumps(mesh, labels, a.mean_curvature);
  EXPECT_EQ(x.rms_normal_jump, y.rms_normal_jump);
  EXPECT_EQ(x.rms_curvature_jump, y.rms_curvature_jump);
  EXPECT_EQ(x.largest_normal_jump.id, y.largest_normal_jump.id);
}

TEST(SurfaceQuality, Refuses) {
  Mesh mesh;
  mesh.points = {{0, 0, 0}};
  test::expect_error(ErrorCode::invalid_argument, {"no faces"}, [&] { surface_quality(mesh); });
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  test::expect_error(ErrorCode::cancelled, {}, [&] { surface_quality(sphere(1, 1), context); });
}

}  // namespace
}  // namespace deform::surface_quality_test
