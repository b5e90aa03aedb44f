// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/measures/faces.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "core/mesh/ahmed.h"
#include "core/mesh/inspect.h"
#include "tests/core/measures/measure_checks.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::measures::faces_test {
namespace {

using test::expect_error;

TEST(Faces, FansAroundTheFirstCorner) {
  Mesh mesh;
  mesh.points.resize(7);
  test::add_face(mesh, {6, 1, 2, 3, 4});
  test::add_face(mesh, {0, 5});
  test::add_face(mesh, {0, 1, 5});
  const FaceTriangles found = chosen_triangles(mesh, {});
  EXPECT_EQ(found.triangles, (std::vector<Triangle>{{6, 1, 2}, {6, 2, 3}, {6, 3, 4}, {0, 1, 5}}));
  EXPECT_EQ(found.faces, (std::vector<FaceId>{0, 0, 0, 2}));
  mesh.face_sizes = {2, 2, 2, 2, 2};
  expect_error(ErrorCode::invalid_argument, {"faces: the mesh has none"}, [&] { chosen_triangles(mesh, {}); });
}

TEST(Faces, CoincidentPoints) {
  std::mt19937_64 random(3);
  std::uniform_int_distribution<int> whole(0, 4);
  Points points;
  for (int i = 0; i < 500; ++i) points.push_back({0.1 * whole(random), -0.0 * whole(random), 1e6 * whole(random)});
  const std::vector<PointId> same = coincident_points(points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(same[i], std::find(points.begin(), points.end(), points[i]) - points.begin());
  }
}

TEST(Body, OfAnAhmedBodyIsClosed) {
  const Mesh mesh = ahmed_body({});
  const Body body(mesh, {}, Rims::refuse);
  EXPECT_FALSE(body.turned());
  EXPECT_EQ(body.rim_count(), 0U);
  EXPECT_EQ(body.point_count(), mesh.point_count());
  EXPECT_EQ(body.triangles().size(), mesh.face_count());
  const Body without_slant(mesh, {{"nose", "roof", "sides", "base", "underbody", "stilts"}, {}}, Rims::close);
  EXPECT_EQ(without_slant.rim_count(), 1U);
  EXPECT_GT(without_slant.triangles().size(), without_slant.faces().size());
}

TEST(Body, EveryRimHasACentreOfItsOwn) {
  Mesh mesh = test::tube(1, 12, 3, 2, test::Faces::triangles);
  const Body body(mesh, {}, Rims::close);
  ASSERT_EQ(body.rim_count(), 2U);
  EXPECT_EQ(body.triangles().size(), mesh.face_count() + 24);
  const Points placed = body.with_centres(mesh.points);
  ASSERT_EQ(placed.size(), mesh.point_count() + 2);
  EXPECT_LT(distance(placed[placed.size() - 2], {0, 0, 0}), 1e-14);
  EXPECT_LT(distance(placed.back(), {0, 0, 2}), 1e-14);
  Points gradient(placed.size());
  gradient.back() = {12, 24, 36};
  body.carry_centres(gradient);
  ASSERT_EQ(gradient.size(), mesh.point_count());
  EXPECT_EQ(gradient[0], Vec3{});
  EXPECT_EQ(gradient[mesh.point_count() - 1], (Vec3{1, 2, 3}));
}

TEST(Body, RefusesWhatHasNoInside) {
  Mesh twisted = test::sphere(1, 2);
  std::swap(twisted.face_points[0], twisted.face_points[1]);
  for (const Rims rims : {Rims::refuse, Rims::close}) {
    expect_error(ErrorCode::invalid_argument, {"faces: those at the edge of points", "oriented against each other"},
                 [&] { Body(twisted, {}, rims); });
  }
  const Mesh flat = test::sheet(3, 3, test::Faces::quads, [](std::uint32_t i, std::uint32_t j) {
    return Vec3{1.0 * i, 1.0 * j, 5};
  });
  expect_error(ErrorCode::invalid_argument, {"faces: they enclose no volume"}, [&] { Body(flat, {}, Rims::close); });
}

}  // namespace
}  // namespace deform::measures::faces_test
