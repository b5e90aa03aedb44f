// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/surface_mesh/one_rings.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "core/mesh/adjacency.h"
#include "core/mesh/ahmed.h"
#include "tests/core/mesh/named_meshes.h"

namespace deform::one_rings_test {
namespace {

template <typename Range>
std::vector<std::uint32_t> sorted_numbers(const Range& range) {
  std::vector<std::uint32_t> numbers;
  for (const auto handle : range) numbers.push_back(handle.index());
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

template <typename Range>
std::vector<std::uint32_t> numbers(const Range& range) {
  std::vector<std::uint32_t> found;
  for (const auto handle : range) found.push_back(handle.index());
  return found;
}

void expect_rings_of(SurfaceMesh& mesh) {
  const OneRings& rings = mesh.one_rings();
  for (const VertexHandle v : mesh.vertices()) {
    EXPECT_EQ(sorted_numbers(rings.neighbours(v)), sorted_numbers(mesh.neighbours(v)));
    EXPECT_EQ(sorted_numbers(rings.faces(v)), sorted_numbers(mesh.faces(v)));
    EXPECT_EQ(rings.is_boundary(v), mesh.is_boundary(v)) << v.index();
  }
  for (const FaceHandle f : mesh.faces()) EXPECT_EQ(numbers(rings.corners(f)), numbers(mesh.vertices(f)));
}

TEST(OneRings, AreThoseOfTheCirculators) {
  for (const Mesh& input : {test::quad_grid(4, 3), test::tetrahedron(), test::open_cone(), test::with_loose_points()}) {
    SurfaceMesh mesh(input);
    expect_rings_of(mesh);
  }
}

TEST(OneRings, HaveTheFacesThatAdjacencyFiles) {
  const Mesh input = ahmed_body({.target_points = 3000});
  SurfaceMesh mesh(input);
  const OneRings& rings = mesh.one_rings();
  const Adjacency adjacency(input);
  for (PointId i = 0; i < input.point_count(); ++i) {
    const auto expected = adjacency.faces_of(i);
    EXPECT_EQ(sorted_numbers(rings.faces(VertexHandle(i))), std::vector<std::uint32_t>(expected.begin(), expected.end()));
  }
}

TEST(OneRings, FollowEveryChangeOfConnectivity) {
  SurfaceMesh mesh(test::quad_grid(3, 3));
  const OneRings* const before = &mesh.one_rings();
  EXPECT_EQ(&mesh.one_rings(), before) << "nothing has changed";
  mesh.set_point(VertexHandle(0), {1, 2, 3});
  EXPECT_EQ(&mesh.one_rings(), before) << "points are no connectivity";
  const auto changed = [&](const auto& change) {
    const std::uint64_t stamp = mesh.topology_stamp();
    change();
    EXPECT_NE(mesh.topology_stamp(), stamp);
    expect_rings_of(mesh);
  };
  changed([&] { mesh.split(FaceHandle(4), {1.5, 1.5, 0}); });
  changed([&] { mesh.split(mesh.edge(mesh.halfedge(FaceHandle(4))), {1, 1, 0}); });
  changed([&] {
    mesh.flip(*std::find_if(mesh.edges().begin(), mesh.edges().end(), [&](EdgeHandle e) { return mesh.can_flip(e); }));
  });
  changed([&] {
    const auto sides = mesh.halfedges(FaceHandle(8));
    mesh.split(*sides.begin(), mesh.next(mesh.next(*sides.begin())));
  });
  changed([&] {
    mesh.collapse(
        *std::find_if(mesh.halfedges().begin(), mesh.halfedges().end(), [&](HalfedgeHandle h) { return mesh.can_collapse(h); }));
  });
  changed([&] { mesh.remove(FaceHandle(0)); });
  changed([&] { mesh.remove(VertexHandle(15)); });
  changed([&] { mesh.add_vertex({9, 9, 9}); });
  changed([&] { mesh.garbage_collection(); });
  changed([&] { mesh.reorder(); });
}

}  // namespace
}  // namespace deform::one_rings_test
