// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/quality/face_intersections.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>
#include <vector>

#include "core/base/vectors.h"
#include "core/mesh/ahmed.h"
#include "core/mesh/triangle_pairs.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::face_intersections_test {
namespace {

using test::Faces;
using testing::ElementsAre;
using testing::IsEmpty;

std::vector<FaceId> ids(const std::vector<IntersectingFace>& faces) {
  std::vector<FaceId> found;
  for (const IntersectingFace& face : faces) found.push_back(face.face);
  return found;
}

/// All of one mesh and then all of the other.
Mesh both(const Mesh& a, const Mesh& b) {
  Mesh mesh = a;
  mesh.points.insert(mesh.points.end(), b.points.begin(), b.points.end());
  mesh.face_sizes.insert(mesh.face_sizes.end(), b.face_sizes.begin(), b.face_sizes.end());
  for (const PointId point : b.face_points) mesh.face_points.push_back(point + static_cast<PointId>(a.point_count()));
  return mesh;
}

Mesh shifted(Mesh mesh, const Vec3& by) {
  for (Vec3& p : mesh.points) p = p + by;
  return mesh;
}

/// By all pairs of triangles.
std::vector<FaceId> by_all_pairs(const Mesh& mesh) {
  std::set<FaceId> found;
  for (std::size_t i = 0; i < mesh.face_count(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const auto corners = [&](std::size_t f) {
        SurfaceTriangle triangle;
        for (std::size_t k = 0; k < 3; ++k) {
          triangle.places[k] = mesh.face_points[3 * f + k];
          triangle.corners[k] = mesh.points[triangle.places[k]];
        }
        return triangle;
      };
      if (has_no_area(corners(i).corners) || has_no_area(corners(j).corners) || !intersect(corners(i), corners(j))) continue;
      found.insert(static_cast<FaceId>(i));
      found.insert(static_cast<FaceId>(j));
    }
  }
  return {found.begin(), found.end()};
}

TEST(IntersectingFaces, AreWhereTwoSheetsCross) {
  // Columns 0..3 of strips 1 wide; the upright sheet stands over the middle of column 2, in its rows 1 and 2 of 4.
  const Mesh floor = test::sheet(4, 4, Faces::quads, [](auto i, auto j) { return Vec3{1.0 * i, 1.0 * j, 0}; });
  const Mesh wall = test::sheet(2, 2, Faces::quads, [](auto i, auto j) { return Vec3{2.4, 1.25 + 0.75 * i, j - 0.7}; });
  const auto found = intersecting_faces(both(floor, wall));
  EXPECT_THAT(ids(found), ElementsAre(6, 10, 16, 17));  // rows 1 and 2 of the third column; the lower row of the wall
  for (const IntersectingFace& face : found) EXPECT_NE(face.face < 16, face.other < 16);
  EXPECT_THAT(intersecting_faces(both(floor, shifted(wall, {0, 0, 0.71}))), IsEmpty());
  EXPECT_THAT(ids(intersecting_faces(both(floor, shifted(wall, {0, 0, 0.7})))), ElementsAre(6, 10, 16, 17));  // it stands on it
}

TEST(IntersectingFaces, AreThoseOfAllPairs) {
  for (const double shake : {0.0, 0.05, 0.3}) {
    Mesh mesh = both(test::sphere(1, 3), shifted(test::sphere(0.7, 3), {0.6, 0.3, 0.2}));
    for (std::size_t i = 0; i < mesh.points.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) mesh.points[i][k] += shake * std::sin(7.0 * static_cast<double>(3 * i + k));
    }
    const auto expected = by_all_pairs(mesh);
    EXPECT_GT(expected.size(), 90U);
    EXPECT_EQ(ids(intersecting_faces(mesh)), expected) << shake;
    // Rounding decides nothing.
    for (Vec3& p : mesh.points) p = {1000 * p[2], 1000 * p[0], 1000 * p[1]};
    EXPECT_EQ(ids(intersecting_faces(mesh)), expected) << shake;
  }
}

TEST(IntersectingFaces, NoneInBodies) {
  EXPECT_THAT(intersecting_faces(test::sphere(3, 5)), IsEmpty());
  EXPECT_THAT(intersecting_faces(test::tube(1, 24, 10, 3, Faces::quads)), IsEmpty());
  AhmedOptions options;
  EXPECT_THAT(intersecting_faces(ahmed_body(options)), IsEmpty());
}

TEST(IntersectingFaces, CornersOfTheirOwnAreNoContact) {
  // As STL files have them: three corners for each facet, which move together.
  const Mesh merged = test::sphere(1, 3);
  Mesh mesh;
  for (const PointId point : merged.face_points) mesh.points.push_back(merged.points[point]);
  for (std::size_t f = 0; f < merged.face_count(); ++f) {
    const auto first = static_cast<PointId>(3 * f);
    test::add_face(mesh, {first, first + 1, first + 2});
  }
  const IntersectionCheck check(mesh, mesh.points);
  EXPECT_THAT(check.at_rest(), IsEmpty());
  Points moved = mesh.points;
  for (Vec3& p : moved) p = {p[0] + 0.1 * p[1] * p[1], 2 * p[1], p[2] - 0.2 * p[0]};
  EXPECT_THAT(check.at(moved), IsEmpty());
}

TEST(IntersectingFaces, OfPolygonsThatAreNotConvex) {
  // An arrow with its notch at corner 2, filled by a triangle, with the fan of the arrow around any corner.
  const Points points{{0, 0, 0}, {2, -2, 0}, {1, 0, 0}, {2, 2, 0}};
  for (PointId first = 0; first < 4; ++first) {
    Mesh mesh;
    mesh.points = points;
    test::add_face(mesh, {first, (first + 1) % 4, (first + 2) % 4, (first + 3) % 4});
    test::add_face(mesh, {1, 3, 2});
    EXPECT_THAT(intersecting_faces(mesh), IsEmpty()) << first;
  }
}

/// A plane sheet of faces with a mid-edge node on each edge, where rounding puts it: of squares, or of triangles.
Mesh quadratic_sheet(bool triangles) {
  constexpr std::size_t n = 9, row = 2 * n + 1;
  Mesh mesh;
  for (std::size_t i = 0; i < row * row; ++i) {
    const double u = static_cast<double>(i % row) / 0.7 / row, v = static_cast<double>(i / row) / 1.3 / row;
    mesh.points.push_back({0.3 * u - 0.9 * v, 0.2 + 0.8 * u + 0.1 * v, 0.37 * u + 0.11 * v});
  }
  const auto add = [&](std::vector<std::array<std::size_t, 2>> corners) {
    std::vector<PointId> polygon;
    for (std::size_t k = 0; k < corners.size(); ++k) {
      const auto& [i, j] = corners[k];
      const auto& [x, y] = corners[(k + 1) % corners.size()];
      polygon.push_back(static_cast<PointId>(j * row + i));
      polygon.push_back(static_cast<PointId>((j + y) / 2 * row + (i + x) / 2));
    }
    for (const PointId point : polygon) mesh.face_points.push_back(point);
    mesh.face_sizes.push_back(static_cast<std::uint32_t>(polygon.size()));
  };
  for (std::size_t j = 0; j + 2 < row; j += 2) {
    for (std::size_t i = 0; i + 2 < row; i += 2) {
      if (triangles) {
        add({{i, j}, {i + 2, j}, {i + 2, j + 2}});
        add({{i, j}, {i + 2, j + 2}, {i, j + 2}});
      } else {
        add({{i, j}, {i + 2, j}, {i + 2, j + 2}, {i, j + 2}});
      }
    }
  }
  return mesh;
}

TEST(IntersectionCheck, OfQuadraticFacesWhoseEdgesBendInTheirPlane) {
  for (const bool triangles : {true, false}) {
    const Mesh mesh = quadratic_sheet(triangles);
    const IntersectionCheck check(mesh, mesh.points);
    EXPECT_THAT(check.at_rest(), IsEmpty());
    for (const double by : {1e-12, 1e-6, 1e-3, 0.1}) {
      Points moved = mesh.points;
      for (Vec3& p : moved) {
        const double u = 3 * p[0] + 7 * p[1];
        p = p + (by * std::sin(u)) * Vec3{0.3, 0.8, 0.37} + (by * std::cos(1.3 * u)) * Vec3{-0.9, 0.1, 0.11};
      }
      EXPECT_THAT(ids(check.appeared(moved)), IsEmpty()) << triangles << ' ' << by;
    }
  }
}

TEST(IntersectingFaces, WithoutAreaArePassedOver) {
  Mesh mesh = test::sheet(2, 2, Faces::triangles, [](auto i, auto j) { return Vec3{1.0 * i, 1.0 * j, 0}; });
  mesh.points.push_back({0.5, 0.2, -1});
  mesh.points.push_back({0.5, 0.2, 1});
  test::add_face(mesh, {9, 10, 9});
  EXPECT_THAT(intersecting_faces(mesh), IsEmpty());
  for (Vec3& p : mesh.points) p = {1, 2, 3};
  EXPECT_THAT(intersecting_faces(mesh), IsEmpty());
}

/// A strip bent to a U, whose legs are `gap` apart.
Mesh bent_strip(double gap, std::uint32_t columns) {
  return test::sheet(columns, 6, Faces::triangles, [&](auto i, auto j) {
    const double s = 6.0 * i / columns - 3, r = gap / 2, y = j / 3.0;
    if (std::abs(s) > 1) return Vec3{std::abs(s), y, std::copysign(r, s)};
    const double angle = s * std::numbers::pi / 2;
    return Vec3{1 - r * std::cos(angle), y, r * std::sin(angle)};
  });
}

TEST(IntersectionCheck, FindsLegsThatCross) {
  for (const std::uint32_t columns : {48U, 97U}) {
    const Mesh mesh = bent_strip(0.4, columns);
    const IntersectionCheck check(mesh, mesh.points);
    EXPECT_THAT(check.at_rest(), IsEmpty());
    const auto bent = [&](double by) {
      Points points = mesh.points;
      for (Vec3& p : points) {
        if (p[0] > 1) p[2] -= std::copysign(by * (p[0] - 1) / 2, p[2]);
      }
      return points;
    };
    EXPECT_THAT(check.appeared(bent(0.19), {}), IsEmpty());
    const auto crossed = check.appeared(bent(0.25), {});  // they cross where 0.25 (x - 1) / 2 = 0.2
    EXPECT_EQ(ids(crossed), ids(check.at(bent(0.25), {})));
    EXPECT_FALSE(crossed.empty());
    for (const IntersectingFace& face : crossed) {
      for (const FaceId f : {face.face, face.other}) {
        double least = 10, most = 0;
        for (std::size_t k = 0; k < 3; ++k) {
          const double x = mesh.points[mesh.face_points[3 * f + k]][0];
          least = std::min(least, x);
          most = std::max(most, x);
        }
        EXPECT_LE(least, 2.6 + 1e-12);
        EXPECT_GE(most, 2.6 - 1e-12);
      }
    }
    RunContext one;
    one.threads = 1;
    EXPECT_EQ(ids(check.appeared(bent(0.6), one)), ids(check.appeared(bent(0.6))));
  }
}

TEST(IntersectionCheck, FindsWhatMeetsInItsPoints) {
  // Onto lines of the other sheet, point on point.
  const Mesh level = test::sheet(8, 8, Faces::quads, [](auto i, auto j) { return Vec3{1.0 * i, 1.0 * j, 0}; });
  const Mesh sloping = test::sheet(8, 8, Faces::quads, [](auto i, auto j) { return Vec3{1.0 * i, 1.0 * j, 1.0 + i}; });
  const Mesh mesh = both(level, sloping);
  const IntersectionCheck check(mesh, mesh.points);
  Points moved = mesh.points;
  for (std::size_t i = level.point_count(); i < moved.size(); ++i) moved[i][2] -= 5;  // they cross at x = 4
  std::vector<FaceId> expected;
  for (FaceId f = 0; f < 128; ++f) {
    if (f % 8 == 3 || f % 8 == 4) expected.push_back(f);
  }
  EXPECT_EQ(ids(check.appeared(moved)), expected);
}

TEST(IntersectionCheck, PartsThatRunThroughEachOtherAtRestHaveNotRunIntoEachOther) {
  // A strut through the floor of a box, and a ball over it.
  const Mesh floor = test::sheet(40, 40, Faces::triangles, [](auto i, auto j) { return Vec3{i / 10.0 - 2, j / 10.0 - 2, 0}; });
  const Mesh strut = shifted(test::tube(0.31, 30, 20, 2, Faces::triangles), {-1, 0.03, -1});
  const Mesh mesh = both(both(floor, strut), shifted(test::sphere(0.5, 3), {1, 0, 0.7}));
  const IntersectionCheck check(mesh, mesh.points);
  EXPECT_GT(check.at_rest().size(), 40U);
  // Sheared and bent all over: other faces of the same places.
  Points bent = mesh.points;
  for (Vec3& p : bent)
    p = {p[0] + 0.2 * p[2] + 0.01 * std::sin(9 * p[1]), p[1] + 0.02 * std::sin(11 * p[0]), p[2] + 0.05 * p[0] * p[0]};
  EXPECT_NE(ids(check.at(bent)), ids(check.at_rest()));
  EXPECT_THAT(check.appeared(bent), IsEmpty());
  // The ball dips into the floor.
  const std::size_t first = floor.point_count() + strut.point_count();
  const auto ball = static_cast<FaceId>(floor.face_count() + strut.face_count());
  for (std::size_t i = first; i < bent.size(); ++i) bent[i][2] -= 0.4;
  const auto found = check.appeared(bent);
  EXPECT_GT(found.size(), 20U);
  for (const IntersectingFace& face : found) EXPECT_NE(face.face >= ball, face.other >= ball);
  EXPECT_LT(found.size(), check.at(bent).size());
}

TEST(IntersectionCheck, AFaceThatIntersectedOneAtRestMayRunIntoAnother) {
  // Teeth over and in a long triangle; one of those over it comes down, to either side of those that were in it.
  for (std::size_t falling = 0; falling < 9; ++falling) {
    SCOPED_TRACE(falling);
    Mesh mesh;
    mesh.points = {{-1, -1, 0}, {30, -1, 0}, {-1, 30, 0}};
    test::add_face(mesh, {0, 1, 2});
    for (std::size_t i = 0; i < 9; ++i) {
      const double x = static_cast<double>(i), low = i == 4 ? -0.5 : 0.5;
      const auto at = static_cast<PointId>(mesh.points.size());
      mesh.points.insert(mesh.points.end(), {{x, 0, low}, {x + 0.2, 0, low + 2}, {x - 0.2, 0, low + 2}});
      test::add_face(mesh, {at, at + 1, at + 2});
    }
    const IntersectionCheck check(mesh, mesh.points);
    EXPECT_THAT(ids(check.at_rest()), ElementsAre(0, 5));
    EXPECT_THAT(check.appeared(mesh.points), IsEmpty());
    Points moved = mesh.points;
    for (std::size_t k = 0; k < 3; ++k) moved[3 + 3 * falling + k][2] -= 1;
    const auto appeared = check.appeared(moved);
    if (falling == 4) {  // it only goes on through the same face
      EXPECT_THAT(appeared, IsEmpty());
      continue;
    }
    const auto tooth = static_cast<FaceId>(falling + 1);
    EXPECT_THAT(ids(appeared), ElementsAre(0, tooth));
    for (const IntersectingFace& face : appeared) EXPECT_EQ(face.other, face.face == 0 ? tooth : 0);
  }
}

TEST(IntersectionCheck, ThatRunThroughManyAtRestMayDoSoAnywhere) {
  // One large triangle through a fine sheet intersects more faces than are kept of it.
  Mesh mesh = test::sheet(60, 60, Faces::triangles, [](auto i, auto j) { return Vec3{i / 10.0, j / 10.0, 0}; });
  mesh.points.insert(mesh.points.end(), {{-1, 3.03, -9}, {7, 3.03, -9}, {3, 3.03, 9}});
  const auto at = static_cast<PointId>(mesh.points.size());
  test::add_face(mesh, {at - 3, at - 2, at - 1});
  const IntersectionCheck check(mesh, mesh.points);
  EXPECT_GT(check.at_rest().size(), 60U);
  Points moved = mesh.points;
  for (std::size_t i = at - 3; i < at; ++i) moved[i][1] += 1.1;
  EXPECT_GT(check.at(moved).size(), 60U);
  EXPECT_THAT(check.appeared(moved), IsEmpty());
}

TEST(IntersectionCheck, BytesAndErrors) {
  const Mesh mesh = both(test::sphere(1, 4), shifted(test::sphere(1, 4), {0.5, 0, 0}));
  const IntersectionCheck check(mesh, mesh.points);
  EXPECT_LE(check.bytes(), IntersectionCheck::bytes_for(mesh));
  EXPECT_GT(check.bytes(), 100 * mesh.face_count());
  EXPECT_GT(check.call_bytes(), 50 * mesh.face_count());
  EXPECT_EQ(check.face_count(), mesh.face_count());
  test::expect_error(ErrorCode::invalid_argument, {"points: 3, expected 2052"}, [&] { check.at(Points(3)); });
  test::expect_error(ErrorCode::invalid_argument, {"points: 4, expected 2052"}, [&] { IntersectionCheck(mesh, Points(4)); });
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  test::expect_error(ErrorCode::cancelled, {}, [&] { check.appeared(mesh.points, context); });
}

}  // namespace
}  // namespace deform::face_intersections_test
