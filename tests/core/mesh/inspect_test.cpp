// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/inspect.h"

#include <gtest/gtest.h>

#include "tests/core/mesh/named_meshes.h"

namespace deform::inspect_test {
namespace {

TEST(InspectTest, AClosedSurface) {
  const MeshReport report = inspect(test::tetrahedron());
  EXPECT_EQ(report.points, 4U);
  EXPECT_EQ(report.faces, 4U);
  EXPECT_EQ(report.corners, 12U);
  EXPECT_EQ(report.triangles, 4U);
  EXPECT_EQ(report.edges, 6U);
  EXPECT_EQ(report.components, 1U);
  EXPECT_EQ(report.boundary_edges, 0U);
  EXPECT_EQ(report.non_manifold_edges, 0U);
  EXPECT_EQ(report.inconsistent_edges, 0U);
  EXPECT_EQ(report.non_manifold_points, 0U);
  EXPECT_EQ(report.degenerate_faces, 0U);
  EXPECT_EQ(report.box.min, (Vec3{0, 0, 0}));
  EXPECT_EQ(report.box.max, (Vec3{1, 1, 1}));
}

TEST(InspectTest, FacesByDegree) {
  Mesh mesh = test::quad_grid(2, 1);
  mesh.face_sizes.insert(mesh.face_sizes.end(), {3, 5, 2});
  mesh.face_points.insert(mesh.face_points.end(), {0, 1, 3, 0, 1, 2, 5, 3, 0, 1});
  const MeshReport report = inspect(mesh);
  EXPECT_EQ(report.triangles, 1U);
  EXPECT_EQ(report.quads, 2U);
  EXPECT_EQ(report.other_faces, 2U);
  EXPECT_EQ(report.degenerate_faces, 1U);  // the face of two corners
}

TEST(InspectTest, CountsEdgesByTheirFaces) {
  const MeshReport grid = inspect(test::quad_grid(3, 2));
  EXPECT_EQ(grid.edges, 17U);
  EXPECT_EQ(grid.boundary_edges, 10U);

  const MeshReport three = inspect(test::non_manifold_edge());
  EXPECT_EQ(three.edges, 7U);
  EXPECT_EQ(three.non_manifold_edges, 1U);
  EXPECT_EQ(three.boundary_edges, 6U);
  EXPECT_EQ(three.inconsistent_edges, 0U);
  EXPECT_EQ(three.non_manifold_points, 2U);

  EXPECT_EQ(inspect(test::flipped_neighbour()).inconsistent_edges, 1U);
}

TEST(InspectTest, ComponentsAreConnectedByPoints) {
  EXPECT_EQ(inspect(test::two_fans()).components, 1U);
  Mesh two = test::tetrahedron();
  two.points.insert(two.points.end(), {{5, 0, 0}, {6, 0, 0}, {5, 1, 0}});
  two.face_sizes.push_back(3);
  two.face_points.insert(two.face_points.end(), {4, 5, 6});
  EXPECT_EQ(inspect(two).components, 2U);
}

TEST(InspectTest, LoosePoints) {
  const MeshReport report = inspect(test::with_loose_points());
  EXPECT_EQ(report.components, 1U);
  EXPECT_EQ(report.isolated_points, 2U);
  EXPECT_EQ(report.coincident_points, 1U);
  EXPECT_EQ(report.non_manifold_points, 0U);
}

TEST(InspectTest, MinusZeroIsTheSamePlaceAsZero) {
  EXPECT_EQ(inspect(test::make_mesh({{0.0, 0, 1}, {-0.0, 0, 1}, {0.0, -0.0, 1}}, {})).coincident_points, 2U);
}

TEST(InspectTest, DegenerateFaces) {
  EXPECT_EQ(inspect(test::repeated_corner()).degenerate_faces, 1U);
  const Mesh flat = test::make_mesh({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {2, 2, 0}}, {{0, 1, 2}, {0, 2, 3}});
  EXPECT_EQ(inspect(flat).degenerate_faces, 1U);
  // The limit is relative to the size of the mesh: 1e-12 D^2.
  const Mesh sliver = test::make_mesh({{0, 0, 0}, {1, 0, 0}, {0.5, 1e-11, 0}, {1, 1, 0}}, {{0, 1, 2}, {0, 1, 3}});
  EXPECT_EQ(inspect(sliver).degenerate_faces, 0U);
  const Mesh thinner = test::make_mesh({{0, 0, 0}, {1, 0, 0}, {0.5, 1e-12, 0}, {1, 1, 0}}, {{0, 1, 2}, {0, 1, 3}});
  EXPECT_EQ(inspect(thinner).degenerate_faces, 1U);
}

TEST(InspectTest, GroupsCountTheirPointsOnce) {
  Mesh mesh = test::quad_grid(2, 1);
  mesh.groups = {{"faces", {}, {0, 1}}, {"both", {0, 0, 5}, {0}}, {"empty", {}, {}}};
  const MeshReport report = inspect(mesh);
  ASSERT_EQ(report.groups.size(), 3U);
  EXPECT_EQ(report.groups[0].name, "faces");
  EXPECT_EQ(report.groups[0].points, 6U);
  EXPECT_EQ(report.groups[0].faces, 2U);
  EXPECT_EQ(report.groups[1].points, 5U);  // four of the quad, and point 5
  EXPECT_EQ(report.groups[2].points, 0U);
}

}  // namespace
}  // namespace deform::inspect_test
