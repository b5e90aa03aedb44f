// SPDX-License-Identifier: GPL-3.0-or-later
// Mirror planes of surfaces that were made symmetric, or not, by construction.
#include "core/mesh/cages/mirror_search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "core/base/vectors.h"
#include "core/mesh/ahmed.h"
#include "tests/core/mesh/cages/cage_checks.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::mirror_search_test {
namespace {

std::vector<TriangleCorners> triangles_of(const Mesh& mesh) {
  std::vector<TriangleCorners> triangles;
  std::size_t at = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    const PointId* const corners = mesh.face_points.data() + at;
    for (std::size_t i = 2; i < size; ++i) {
      triangles.push_back({mesh.points[corners[0]], mesh.points[corners[i - 1]], mesh.points[corners[i]]});
    }
    at += size;
  }
  return triangles;
}

/// A box from -sides/2 to sides/2 whose faces are triangulated at random, so that no vertex has an image.
std::vector<TriangleCorners> box_at_random(const Vec3& sides, std::size_t splits) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> part(0.2, 0.8);
  std::vector<TriangleCorners> triangles;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t a = (k + 1) % 3, b = (k + 2) % 3;
    for (const double side : {-0.5, 0.5}) {
      const auto corner = [&](double u, double v) {
        Vec3 x{};
        x[k] = side * sides[k];
        x[a] = u * sides[a];
        x[b] = v * sides[b];
        return x;
      };
      triangles.push_back({corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5)});
      triangles.push_back({corner(-0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)});
    }
  }
  for (std::size_t i = 0; i < splits; ++i) {
    const TriangleCorners t = triangles[random() % triangles.size()];
    double u = part(random), v = part(random);
    if (u + v > 1) u = 1 - u, v = 1 - v;
    const std::size_t k = static_cast<std::size_t>(std::find(triangles.begin(), triangles.end(), t) - triangles.begin());
    // Exactly in the face, whose coordinate across all corners have.
    Vec3 x = (1 - u - v) * t[0] + u * t[1] + v * t[2];
    for (std::size_t c = 0; c < 3; ++c) {
      if (t[0][c] == t[1][c] && t[0][c] == t[2][c]) x[c] = t[0][c];
    }
    triangles[k] = {t[0], t[1], x};
    triangles.push_back({t[1], t[2], x});
    triangles.push_back({t[2], t[0], x});
  }
  return triangles;
}

Vec3 turned(const Vec3& x) {
  const double c = std::cos(0.7), s = std::sin(0.7);
  const Vec3 y{c * x[0] - s * x[1], s * x[0] + c * x[1], x[2]};
  return {y[0], 0.6 * y[1] - 0.8 * y[2], 0.8 * y[1] + 0.6 * y[2]};
}

template <typename Map>
std::vector<TriangleCorners> mapped(std::vector<TriangleCorners> triangles, const Map& map) {
  for (TriangleCorners& t : triangles) {
    for (Vec3& x : t) x = map(x);
  }
  return triangles;
}

SurfaceMirrors mirrors_of(const std::vector<TriangleCorners>& triangles, double tolerance) {
  return surface_mirrors(triangles, tolerance);
}

TEST(SurfaceMirrors, OfACarInAnyPositionAndUnit) {
  const std::vector<TriangleCorners> car = triangles_of(ahmed_body({.target_points = 2000}));
  const SurfaceMirrors usual = mirrors_of(car, 1e-3);
  ASSERT_EQ(usual.planes.size(), 1u);
  EXPECT_EQ(usual.planes[0].normal, (Vec3{0, 1, 0}));
  EXPECT_EQ(usual.planes[0].point, (Vec3{0, 0, 0}));
  EXPECT_EQ(usual.deviation, 0);
  EXPECT_FALSE(usual.near);
  const Vec3 moved{3, -7, 2};
  for (const double unit : {1e-3, 1.0, 1e3}) {
    SCOPED_TRACE(unit);
    const auto place = [&](const Vec3& x) { return unit * (turned(x) + moved); };
    const SurfaceMirrors found = mirrors_of(mapped(car, place), 1e-6 * unit);
    ASSERT_EQ(found.planes.size(), 1u);
    EXPECT_NEAR(std::abs(dot(found.planes[0].normal, turned({0, 1, 0}))), 1, 1e-12);
    EXPECT_NEAR(dot(found.planes[0].normal, found.planes[0].point - unit * moved), 0, 1e-12 * unit);
    EXPECT_LT(found.deviation, 1e-13 * unit);
  }
}

// Noise draws the best plane a little away, but not by enough to leave the axis.
TEST(SurfaceMirrors, AreAcrossAxesIfThatIsAlmostAsGood) {
  std::mt19937_64 random(7);
  for (int i = 0; i < 3; ++i) {
    Mesh car = ahmed_body({.target_points = 2000});
    std::uniform_real_distribution<double> noise(-1e-4, 1e-4);
    for (Vec3& x : car.points) x = x + Vec3{noise(random), noise(random), noise(random)};
    const SurfaceMirrors found = mirrors_of(triangles_of(car), 1e-3);
    ASSERT_EQ(found.planes.size(), 1u);
    EXPECT_EQ(found.planes[0].normal, (Vec3{0, 1, 0}));
    EXPECT_EQ(found.planes[0].point, (Vec3{0, 0, 0}));
    EXPECT_GT(found.deviation, 1e-4);
  }
}

// All vertices lie where no other has its image; only the surface is symmetric.
TEST(SurfaceMirrors, AreThoseOfTheSurfaceNotOfItsVertices) {
  const Vec3 sides{2, 1.3, 0.7};
  const std::vector<TriangleCorners> box = box_at_random(sides, 600);
  const SurfaceMirrors found = mirrors_of(box, 1e-9);
  ASSERT_EQ(found.planes.size(), 3u);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(std::abs(found.planes[k].normal[k]), 1);
    EXPECT_EQ(found.planes[k].point[k], 0);
  }
  EXPECT_LT(found.deviation, 1e-13);
  // Moved away, through the middle of the box.
  const SurfaceMirrors beside = mirrors_of(mapped(box, [](const Vec3& x) { return x + Vec3{4, 0, 0}; }), 1e-9);
  ASSERT_EQ(beside.planes.size(), 3u);
  EXPECT_NEAR(beside.planes[0].point[0], 4, 1e-15);
  const SurfaceMirrors other = mirrors_of(mapped(box, turned), 1e-9);
  ASSERT_EQ(other.planes.size(), 3u);
  double across = 0;
  for (const CagePlane& plane : other.planes) {
    for (const Vec3& axis : {turned({1, 0, 0}), turned({0, 1, 0}), turned({0, 0, 1})}) {
      across += std::abs(dot(plane.normal, axis)) > 1 - 1e-12 ? 1 : 0;
    }
    EXPECT_NEAR(dot(plane.normal, plane.point), 0, 1e-12);
  }
  EXPECT_EQ(across, 3);
}

// Two principal moments of a square bar are the same: no axis is told from another by them.
TEST(SurfaceMirrors, OfABarWhosePrincipalAxesAreAny) {
  const SurfaceMirrors found = mirrors_of(mapped(box_at_random({3, 1, 1}, 400), turned), 1e-6);
  ASSERT_EQ(found.planes.size(), 3u);
  EXPECT_LT(found.deviation, 1e-7);
}

// A bump of a known height on one side. Seen from either side it is farthest from its image at its top.
TEST(SurfaceMirrors, AreNoneBeyondTheTolerance) {
  const Mesh car = ahmed_body({.target_points = 10000});
  Vec3 top{};
  for (const Vec3& x : car.points) {
    if (x[1] > top[1] + 1e-12 || (x[1] > top[1] - 1e-12 && std::abs(x[0] - 0.5) < std::abs(top[0] - 0.5))) top = x;
  }
  const double diagonal = bounding_box(car.points).diagonal(), height = 1e-3 * diagonal;
  for (const bool elsewhere : {false, true}) {
    SCOPED_TRACE(elsewhere);
    Mesh bumped = car;
    for (Vec3& x : bumped.points) {
      const double r = distance(x, top) / (0.1 * diagonal);
      x[1] += height * std::exp(-r * r);
      if (elsewhere) x = turned(x);
    }
    const std::vector<TriangleCorners> triangles = triangles_of(bumped);
    const Vec3 across = elsewhere ? turned({0, 1, 0}) : Vec3{0, 1, 0};
    const SurfaceMirrors none = mirrors_of(triangles, 0.8 * height);
    EXPECT_TRUE(none.planes.empty());
    ASSERT_TRUE(none.near);
    // A plane that is moved a little misses the top by less.
    EXPECT_NEAR(std::abs(dot(none.near->plane.normal, across)), 1, elsewhere ? 1e-7 : 0);
    EXPECT_NEAR(none.near->deviation, height, 0.1 * height);
    EXPECT_LT(std::min(distance(none.near->at, elsewhere ? turned(top) : top),
                       distance(reflected(none.near->plane, none.near->at), elsewhere ? turned(top) : top)),
              0.03 * diagonal);
    const SurfaceMirrors one = mirrors_of(triangles, 1.05 * height);
    ASSERT_EQ(one.planes.size(), 1u);
    EXPECT_NEAR(std::abs(dot(one.planes[0].normal, across)), 1, elsewhere ? 1e-7 : 0);
    EXPECT_NEAR(one.deviation, height, 0.1 * height);
    EXPECT_FALSE(one.near);
    const SurfaceMirrors far = mirrors_of(triangles, height / 40);
    EXPECT_TRUE(far.planes.empty());
    EXPECT_FALSE(far.near);
  }
}

TEST(SurfaceMirrors, OfWhatHasNone) {
  EXPECT_TRUE(mirrors_of({{{{0, 0, 0}, {1, 0, 0}, {0, 2, 0}}}, {{{0, 0, 0}, {1, 0, 0}, {0.3, 0.2, 3}}}}, 1e-6).planes.empty());
  EXPECT_TRUE(surface_mirrors({}, 1).planes.empty());
  EXPECT_TRUE(mirror_candidates({}).empty());
  const std::vector<TriangleCorners> car = triangles_of(ahmed_body({.target_points = 2000}));
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  test::expect_error(ErrorCode::cancelled, {}, [&] { (void)surface_mirrors(car, 1e-3, context); });
}

// Which side comes first is not decided by rounding.
TEST(MirrorFrame, IsOnTheSideOfTheNormalIfTheModelIsOnBoth) {
  const std::vector<CagePlane> plane{{{}, {1, 0, 0}}};
  Mesh mesh;
  for (const double less : {-1e-15, 0.0, 1e-15, 1e-4}) {
    mesh.points = {{1 - less, 0, 0}, {-1, 0, 0}};
    EXPECT_EQ(MirrorFrame(plane, mesh).coordinates({0.5, 0, 0})[0], 0.5) << less;
  }
  mesh.points = {{0.9, 0, 0}, {-1, 0, 0}};
  EXPECT_EQ(MirrorFrame(plane, mesh).coordinates({0.5, 0, 0})[0], -0.5);
}

TEST(CagePlane, IsTold) {
  EXPECT_EQ(plane_text({{5, 0, 7}, {0, -2, 0}}), "y = 0");
  EXPECT_EQ(plane_text({{0.25, 0, 7}, {1, 0, 0}}), "x = 0.25");
  EXPECT_EQ(plane_text({{1, 0, 2}, {3, 4, 0}}), "the plane through (1, 0, 2) across (0.6, 0.8, 0)");
  const std::vector<CagePlane> planes{{{}, {1, 0, 0}}, {{}, {0, 1, 0}}, {{0, 0, 3}, {0, 0, 1}}};
  EXPECT_EQ(planes_text(planes), "x = 0, y = 0 and z = 3");
  EXPECT_EQ(planes_text({planes.data(), 1}), "x = 0");
}

}  // namespace
}  // namespace deform::mirror_search_test
