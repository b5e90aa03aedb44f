// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/surface_mesh/surface_mesh.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "core/mesh/adjacency.h"
#include "core/mesh/ahmed.h"
#include "core/mesh/inspect.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::surface_mesh_test {
namespace {

using test::expect_error;
using testing::ElementsAre;

template <typename Range>
std::vector<std::uint32_t> numbers(const Range& range) {
  std::vector<std::uint32_t> found;
  for (const auto handle : range) found.push_back(handle.index());
  return found;
}

void expect_refused(const Mesh& mesh, const std::vector<const char*>& parts) {
  expect_error(ErrorCode::invalid_argument, parts, [&] { SurfaceMesh refused(mesh); });
}

TEST(SurfaceMesh, KeepsPointsAndFaces) {
  for (const Mesh& input : {test::one_ring(), test::quad_grid(3, 2), test::tetrahedron(), test::with_loose_points(),
                            ahmed_body({.target_points = 2000})}) {
    const SurfaceMesh mesh(input);
    mesh.check();
    const Mesh output = mesh.to_mesh();
    EXPECT_EQ(output.points, input.points);
    EXPECT_EQ(output.face_sizes, input.face_sizes);
    EXPECT_EQ(output.face_points, input.face_points);
    const MeshReport report = inspect(input);
    EXPECT_EQ(mesh.edge_count(), report.edges);
    const auto edges = mesh.edges();
    EXPECT_EQ(std::count_if(edges.begin(), edges.end(), [&](EdgeHandle e) { return mesh.is_boundary(e); }),
              static_cast<std::ptrdiff_t>(report.boundary_edges));
  }
}

TEST(SurfaceMesh, CirculatesClockwiseAroundVerticesAndTheOtherWayAroundFaces) {
  const SurfaceMesh mesh(test::one_ring());
  std::vector<std::uint32_t> ring = numbers(mesh.neighbours(VertexHandle(0)));
  std::rotate(ring.begin(), std::find(ring.begin(), ring.end(), 6), ring.end());
  EXPECT_THAT(ring, ElementsAre(6, 5, 4, 3, 2, 1));
  EXPECT_EQ(mesh.valence(VertexHandle(0)), 6u);
  EXPECT_EQ(numbers(mesh.faces(VertexHandle(0))).size(), 6u);
  EXPECT_THAT(numbers(mesh.vertices(FaceHandle(2))), ElementsAre(0, 3, 4));
  EXPECT_THAT(numbers(mesh.faces(VertexHandle(2))), testing::UnorderedElementsAre(0, 1)) << "the hole is no face";
  EXPECT_EQ(mesh.valence(VertexHandle(2)), 3u);
}

TEST(SurfaceMesh, PreviousIsTheOtherWayOfNext) {
  for (const Mesh& input : {test::quad_grid(3, 2), test::open_cone(), test::tetrahedron()}) {
    const SurfaceMesh mesh(input);
    for (const HalfedgeHandle h : mesh.halfedges()) EXPECT_EQ(mesh.previous(mesh.next(h)), h);
  }
}

TEST(SurfaceMesh, TellsBoundariesAsAdjacencyDoes) {
  for (const Mesh& input : {test::one_ring(), test::open_cone(), test::tetrahedron(), test::quad_grid(4, 4)}) {
    const SurfaceMesh mesh(input);
    const std::vector<char> expected = Adjacency(input).boundary_points();
    for (PointId i = 0; i < input.point_count(); ++i) EXPECT_EQ(mesh.is_boundary(VertexHandle(i)), expected[i] != 0);
  }
  const SurfaceMesh loose(test::with_loose_points());
  EXPECT_TRUE(loose.is_isolated(VertexHandle(3)));
  EXPECT_TRUE(loose.is_boundary(VertexHandle(3)));
  EXPECT_EQ(loose.valence(VertexHandle(3)), 0u);
  EXPECT_TRUE(numbers(loose.faces(VertexHandle(3))).empty());
}

TEST(SurfaceMesh, FindsEdges) {
  const SurfaceMesh mesh(test::quad_grid(2, 2));
  const HalfedgeHandle h = mesh.find_halfedge(VertexHandle(4), VertexHandle(5));
  ASSERT_TRUE(h.valid());
  EXPECT_EQ(mesh.source(h), VertexHandle(4));
  EXPECT_EQ(mesh.target(h), VertexHandle(5));
  EXPECT_EQ(mesh.find_halfedge(VertexHandle(5), VertexHandle(4)), SurfaceMesh::opposite(h));
  EXPECT_FALSE(mesh.find_halfedge(VertexHandle(0), VertexHandle(4)).valid()) << "a diagonal";
}

TEST(SurfaceMesh, RefusesWhatIsNotManifoldAndNamesIt) {
  expect_refused(test::non_manifold_edge(), {"edge 0-1 has 3 faces (0, 1, 2)"});
  expect_refused(test::flipped_neighbour(), {"faces 0, 1 run along edge 0-1 in the same direction"});
  expect_refused(test::two_fans(), {"vertex 0", "more than one fan"});
  expect_refused(test::repeated_corner(), {"face 1 repeats point 1"});
  expect_refused(test::make_mesh({{0, 0, 0}, {1, 0, 0}}, {{0, 1}}), {"face 0 has 2 corners"});
  // Two fans that are open: two triangles that touch in point 0.
  expect_refused(test::make_mesh({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {-1, 0, 0}, {-1, -1, 0}}, {{0, 1, 2}, {0, 3, 4}}),
                 {"vertex 0", "more than one fan"});
  // The same triangle twice.
  expect_refused(test::make_mesh({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}}, {{0, 1, 2}, {0, 1, 2}}), {"faces 0, 1 run along edge 0-1"});
  expect_refused(test::make_mesh({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}}, {{0, 1, 3}}), {"3"});
}

TEST(SurfaceMesh, TakesAVertexOfManyFaces) {
  const unsigned n = 2000;
  Mesh fan;
  fan.points.assign(n + 1, {0, 0, 0});
  for (unsigned i = 0; i < n; ++i) {
    fan.face_sizes.push_back(3);
    fan.face_points.insert(fan.face_points.end(), {0, 1 + i, 1 + (i + 1) % n});
  }
  const SurfaceMesh mesh(fan);
  mesh.check();
  EXPECT_EQ(mesh.valence(VertexHandle(0)), n);
}

TEST(SurfaceMesh, TakesAnEmptyMesh) {
  SurfaceMesh mesh;
  EXPECT_EQ(mesh.vertex_count() + mesh.edge_count() + mesh.face_count(), 0u);
  mesh.garbage_collection();
  mesh.reorder();
  mesh.check();
}

TEST(SurfaceMesh, IsPutTogetherFaceByFaceInAnyOrder) {
  const Mesh body = ahmed_body({.target_points = 2000});
  std::vector<std::size_t> order(body.face_count());
  std::iota(order.begin(), order.end(), 0);
  // Patches that grow into each other make vertices with several fans on the way.
  std::shuffle(order.begin(), order.end(), std::mt19937(7));
  SurfaceMesh mesh;
  for (const Vec3& point : body.points) mesh.add_vertex(point);
  for (const std::size_t f : order) {
    const PointId* c = &body.face_points[3 * f];
    mesh.add_face(std::vector{VertexHandle(c[0]), VertexHandle(c[1]), VertexHandle(c[2])});
  }
  mesh.check();
  EXPECT_EQ(mesh.face_count(), body.face_count());
  const SurfaceMesh at_once(body);
  EXPECT_EQ(mesh.edge_count(), at_once.edge_count());
  for (const VertexHandle v : mesh.vertices()) {
    ASSERT_FALSE(mesh.is_boundary(v));
    ASSERT_EQ(mesh.valence(v), at_once.valence(v));
  }
}

TEST(SurfaceMesh, RefusesFacesWithoutAPlace) {
  SurfaceMesh mesh(test::one_ring());
  const auto add = [&](std::vector<std::uint32_t> corners) {
    std::vector<VertexHandle> handles;
    for (const std::uint32_t v : corners) handles.emplace_back(v);
    mesh.add_face(handles);
  };
  const VertexHandle fresh = mesh.add_vertex({0, 0, 9});
  expect_error(ErrorCode::invalid_argument, {"edge 1-2 has a face"}, [&] { add({1, 2, fresh.index()}); });
  expect_error(ErrorCode::invalid_argument, {"no gap", "vertex 0"}, [&] { add({0, 1, fresh.index()}); });
  expect_error(ErrorCode::invalid_argument, {"repeats vertex 2"}, [&] { add({2, 1, 2}); });
  expect_error(ErrorCode::invalid_argument, {"three corners"}, [&] { add({2, 1}); });
  mesh.check();
  EXPECT_EQ(mesh.face_count(), 6u);
  add({2, 1, fresh.index()});
  mesh.check();
  EXPECT_EQ(mesh.face_count(), 7u);
}

TEST(SurfaceMesh, RemovedFacesLeaveFansThatCirculateWhole) {
  SurfaceMesh mesh(test::one_ring());
  mesh.remove(FaceHandle(0));
  mesh.remove(FaceHandle(3));
  mesh.check();
  EXPECT_EQ(mesh.valence(VertexHandle(0)), 6u);
  EXPECT_THAT(numbers(mesh.faces(VertexHandle(0))), testing::UnorderedElementsAre(1, 2, 4, 5));
  mesh.remove(FaceHandle(1));
  mesh.remove(FaceHandle(2));
  mesh.check();
  EXPECT_EQ(mesh.valence(VertexHandle(0)), 3u);
  EXPECT_TRUE(mesh.is_isolated(VertexHandle(2)));
  EXPECT_FALSE(mesh.is_removed(VertexHandle(2))) << "a vertex outlives its faces";
}

TEST(SurfaceMesh, RangesSkipWhatIsRemovedOnTheWay) {
  SurfaceMesh mesh(test::quad_grid(4, 1));
  std::vector<std::uint32_t> visited;
  for (const FaceHandle f : mesh.faces()) {
    visited.push_back(f.index());
    if (f.index() == 0) mesh.remove(FaceHandle(1));
    if (f.index() == 2) mesh.split(f, {0, 0, 0});  // what is added is not visited
  }
  EXPECT_THAT(visited, ElementsAre(0, 2, 3));
}

TEST(SurfaceMesh, CollectsGarbageInOrder) {
  SurfaceMesh mesh(test::quad_grid(3, 1));
  mesh.remove(VertexHandle(0));
  expect_error(ErrorCode::failed_precondition, {"garbage_collection"}, [&] { (void)mesh.to_mesh(); });
  mesh.garbage_collection();
  mesh.check();
  EXPECT_FALSE(mesh.has_removed());
  const Mesh left = mesh.to_mesh();
  EXPECT_EQ(left.points.front(), (Vec3{1, 0, 0}));
  EXPECT_THAT(left.face_points, ElementsAre(0, 1, 5, 4, 1, 2, 6, 5)) << "point 4 became 3, which has lost its face";
}

TEST(SurfaceMesh, PropertiesAreTypedAndNamed) {
  SurfaceMesh mesh(test::tetrahedron());
  auto weight = mesh.add_property<EdgeHandle, double>("weight", 2.5);
  weight[EdgeHandle(3)] = 7;
  expect_error(ErrorCode::already_exists, {"weight"}, [&] { mesh.add_property<EdgeHandle, int>("weight"); });
  expect_error(ErrorCode::invalid_argument, {"weight", "type"}, [&] { (void)mesh.find_property<EdgeHandle, int>("weight"); });
  EXPECT_FALSE((mesh.find_property<EdgeHandle, double>("height").valid()));
  EXPECT_FALSE((mesh.find_property<FaceHandle, double>("weight").valid())) << "of another kind";
  SurfaceMesh copy = mesh;
  (copy.find_property<EdgeHandle, double>("weight"))[EdgeHandle(3)] = 9;
  EXPECT_EQ(weight[EdgeHandle(3)], 7) << "copies have arrays of their own";
  const SurfaceMesh moved = std::move(mesh);
  EXPECT_EQ(weight[EdgeHandle(3)], 7) << "moved with the mesh";
  copy.split(FaceHandle(0), {0, 0, 0});
  EXPECT_EQ((copy.find_property<EdgeHandle, double>("weight"))[EdgeHandle(8)], 2.5) << "new entities have the default value";
  auto found = copy.find_property<EdgeHandle, double>("weight");
  copy.remove_property(found);
  EXPECT_FALSE(found.valid());
  EXPECT_FALSE((copy.find_property<EdgeHandle, double>("weight").valid()));
}

TEST(SurfaceMesh, NewEntitiesAfterGarbageCollectionHaveDefaultValues) {
  SurfaceMesh mesh(test::tetrahedron());
  auto mark = mesh.add_property<FaceHandle, int>("mark", 1);
  const VertexHandle v = mesh.split(FaceHandle(0), {0.3, 0.3, 0});
  for (const FaceHandle f : mesh.faces()) mark[f] = 5;
  mesh.collapse(mesh.halfedge(v));
  mesh.garbage_collection();
  EXPECT_EQ(mesh.face_slots(), 4u);
  mesh.split(FaceHandle(1), {0.3, 0, 0.3});
  EXPECT_EQ(mark[FaceHandle(1)], 5);
  EXPECT_EQ(mark[FaceHandle(4)], 1);
  EXPECT_EQ(mark[FaceHandle(5)], 1);
}

TEST(SurfaceMesh, CollapseOfASplitRestoresTheNumbers) {
  const Mesh input = ahmed_body({.target_points = 2000});
  SurfaceMesh mesh(input);
  const std::size_t faces = mesh.face_count(), points = mesh.vertex_count();
  for (std::uint32_t f = 0; f < faces; ++f) mesh.split(FaceHandle(f), {0, 0, 0});
  for (auto v = static_cast<std::uint32_t>(points); v < mesh.vertex_slots(); ++v) {
    ASSERT_TRUE(mesh.can_collapse(mesh.halfedge(VertexHandle(v))));
    mesh.collapse(mesh.halfedge(VertexHandle(v)));
  }
  mesh.garbage_collection();
  mesh.check();
  EXPECT_EQ(mesh.to_mesh().face_points, input.face_points);
}

TEST(SurfaceMesh, DoesNotCollapseAChordOfAPolygon) {
  // A hexagon, closed by two quads that meet in edge 0-1: without it the hexagon would have one point twice.
  const SurfaceMesh mesh(test::make_mesh({{0, 0, 0}, {3, 0, 0}, {1, 1, 0}, {2, 1, 0}, {2, -1, 0}, {1, -1, 0}},
                                         {{0, 2, 3, 1, 4, 5}, {1, 3, 2, 0}, {0, 5, 4, 1}}));
  EXPECT_FALSE(mesh.can_collapse(mesh.find_halfedge(VertexHandle(0), VertexHandle(1))));
  EXPECT_TRUE(mesh.can_collapse(mesh.find_halfedge(VertexHandle(2), VertexHandle(3))));
}

TEST(SurfaceMesh, ReorderBringsNeighboursTogether) {
  Mesh input = ahmed_body({.target_points = 5000});
  std::vector<PointId> shuffled(input.point_count());
  std::iota(shuffled.begin(), shuffled.end(), 0);
  std::shuffle(shuffled.begin(), shuffled.end(), std::mt19937(3));
  Points points(input.points.size());
  for (std::size_t i = 0; i < points.size(); ++i) points[shuffled[i]] = input.points[i];
  input.points = points;
  for (PointId& point : input.face_points) point = shuffled[point];
  SurfaceMesh mesh(input);
  const auto spread = [&] {
    double sum = 0;
    for (const EdgeHandle e : mesh.edges()) {
      const HalfedgeHandle h = SurfaceMesh::halfedge(e);
      sum += std::abs(static_cast<double>(mesh.source(h).index()) - static_cast<double>(mesh.target(h).index()));
    }
    return sum / static_cast<double>(mesh.edge_count());
  };
  const double before = spread();
  const Reordering order = mesh.reorder();
  mesh.check();
  EXPECT_LT(spread(), before / 10);
  for (std::uint32_t i = 0; i < order.vertices.size(); ++i) {
    ASSERT_EQ(mesh.point(VertexHandle(i)), input.points[order.vertices[i]]);
  }
  for (std::uint32_t f = 0; f < order.faces.size(); ++f) {
    std::vector<std::uint32_t> corners;
    for (const VertexHandle v : mesh.vertices(FaceHandle(f))) corners.push_back(order.vertices[v.index()]);
    const PointId* old = &input.face_points[3 * order.faces[f]];
    ASSERT_TRUE(std::equal(corners.begin(), corners.end(), old));
  }
}

TEST(SurfaceMesh, TakesAtMost200BytesPerVertex) {
  SurfaceMesh mesh(ahmed_body({.target_points = 50000}));
  mesh.add_property<VertexHandle, Vec3>("normal");
  mesh.add_property<FaceHandle, Vec3>("normal");
  // 24 points, 24 and 2 x 24 normals, 4 + 2 x 4 half-edges of vertices and faces, 6 x 12 half-edges.
  EXPECT_NEAR(static_cast<double>(mesh.bytes()) / static_cast<double>(mesh.vertex_count()), 180, 1);
}

}  // namespace
}  // namespace deform::surface_mesh_test
