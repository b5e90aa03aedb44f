// SPDX-License-Identifier: GPL-3.0-or-later
// Shapes of all element types and the faces of their boundary.
#include "core/mesh/elements.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <map>
#include <numeric>
#include <set>

#include "tests/core/mesh/straight_elements.h"
#include "tests/support/expect_error.h"

namespace deform::elements_test {
namespace {

std::vector<ElementType> all_types() {
  std::vector<ElementType> types(element_types);
  for (std::size_t i = 0; i < types.size(); ++i) types[i] = static_cast<ElementType>(i);
  return types;
}

Elements one(ElementType type, PointId first = 0) {
  std::vector<PointId> nodes(shape(type).nodes);
  std::iota(nodes.begin(), nodes.end(), first);
  Elements elements;
  elements.add(type, nodes);
  return elements;
}

Vec3 middle(const Vec3& a, const Vec3& b) { return {(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2}; }

TEST(ElementShape, NodesStandWhereCgnsPutsThem) {
  for (const auto& [type, points] : straight_elements()) {
    const ElementShape& form = shape(type);
    SCOPED_TRACE(form.name);
    ASSERT_EQ(form.nodes, points.size());
    std::set<std::size_t> seen;
    for (std::size_t i = 0; i < form.edges.size(); ++i) {
      if (!form.quadratic()) break;
      EXPECT_EQ(points[form.corners + i], middle(points[form.edges[i][0]], points[form.edges[i][1]])) << "edge " << i;
    }
    for (std::size_t f = 0; f < form.faces.size(); ++f) {
      const auto& face = form.faces[f];
      seen.insert(face.begin(), face.end());
      const std::size_t step = form.quadratic() ? 2 : 1;
      for (std::size_t c = 1; c < face.size() && form.quadratic(); c += 2) {
        EXPECT_EQ(points[face[c]], middle(points[face[c - 1]], points[face[(c + 1) % face.size()]])) << "face " << f;
      }
      EXPECT_LT(face[0], form.corners);
      if (form.face_centre(f) == ElementShape::no_node) continue;
      seen.insert(form.face_centre(f));
      EXPECT_EQ(points[form.face_centre(f)], middle(points[face[0]], points[face[2 * step]])) << "face " << f;
    }
    EXPECT_EQ(seen.size(), form.nodes - (type == ElementType::hexahedron27 ? 1 : 0)) << "all but an inner one lie in faces";
  }
}

/// Six times the volume within a closed surface; faces as fans.
double six_volumes(const Points& points, const std::vector<std::uint32_t>& sizes, const std::vector<PointId>& corners) {
  double sum = 0;
  std::size_t at = 0;
  for (const std::uint32_t size : sizes) {
    for (std::size_t c = 1; c + 1 < size; ++c) {
      const Vec3 &a = points[corners[at]], &b = points[corners[at + c]], &d = points[corners[at + c + 1]];
      sum += a[0] * (b[1] * d[2] - b[2] * d[1]) - a[1] * (b[0] * d[2] - b[2] * d[0]) + a[2] * (b[0] * d[1] - b[1] * d[0]);
    }
    at += size;
  }
  return sum;
}

// The boundary of one element is closed and outward, and holds every node but an inner one.
TEST(BoundaryFaces, PartitionAndOrientation) {
  const std::map<std::size_t, double> volumes{{4, 8}, {5, 16}, {6, 24}, {8, 48}};  // sixths, by corners
  for (const auto& [type, points] : straight_elements()) {
    const ElementShape& form = shape(type);
    SCOPED_TRACE(form.name);
    const BoundaryFaces boundary = boundary_faces(one(type));
    EXPECT_DOUBLE_EQ(six_volumes(points, boundary.sizes, boundary.points), volumes.at(form.corners));
    EXPECT_EQ(boundary.sides.size(), form.faces.size() + 1);
    EXPECT_EQ(boundary.sides.back(), boundary.sizes.size());
    std::map<std::pair<PointId, PointId>, int> edges;
    std::size_t at = 0;
    for (const std::uint32_t size : boundary.sizes) {
      for (std::size_t c = 0; c < size; ++c) ++edges[{boundary.points[at + c], boundary.points[at + (c + 1) % size]}];
      at += size;
    }
    for (const auto& [edge, times] : edges) {
      EXPECT_EQ(times, 1);
      EXPECT_EQ(edges.count({edge.second, edge.first}), 1u) << edge.first << ' ' << edge.second;
    }
    const std::set<PointId> used(boundary.points.begin(), boundary.points.end());
    EXPECT_EQ(used.size(), form.nodes - (type == ElementType::hexahedron27 ? 1 : 0));
  }
}

TEST(BoundaryFaces, SplitsAroundNodesAmidFaces) {
  const auto count = [](ElementType type) { return boundary_faces(one(type)).sizes.size(); };
  EXPECT_EQ(count(ElementType::pyramid14), 4u + 4);
  EXPECT_EQ(count(ElementType::prism18), 2u + 12);
  EXPECT_EQ(count(ElementType::hexahedron27), 24u);
  EXPECT_EQ(count(ElementType::hexahedron20), 6u);
  const BoundaryFaces boundary = boundary_faces(one(ElementType::pyramid14));
  EXPECT_EQ((std::vector<PointId>(boundary.points.begin(), boundary.points.begin() + 4)), (std::vector<PointId>{0, 8, 13, 5}));
  EXPECT_EQ(boundary.sides[1], 4u);
}

// Every face of every type glued to a mirror image of itself is inside, and all others stay on the boundary.
TEST(BoundaryFaces, NeighboursShareFacesByAllTheirNodes) {
  for (const ElementType type : all_types()) {
    const ElementShape& form = shape(type);
    for (std::size_t f = 0; f < form.faces.size(); ++f) {
      SCOPED_TRACE(form.name + (" face " + std::to_string(f)));
      std::vector<PointId> nodes(form.nodes);
      std::iota(nodes.begin(), nodes.end(), 100u);
      for (const std::uint8_t node : form.faces[f]) nodes[node] = node;
      if (form.face_centre(f) != ElementShape::no_node) nodes[form.face_centre(f)] = form.face_centre(f);
      Elements elements = one(type);
      elements.add(type, nodes);
      EXPECT_EQ(boundary_faces(elements).sides.size() - 1, 2 * (form.faces.size() - 1));
      if (!form.quadratic()) continue;
      // Another mid node on one edge: no longer the same face.
      nodes[form.faces[f][1]] = 500;
      Elements apart = one(type);
      apart.add(type, nodes);
      EXPECT_EQ(boundary_faces(apart).sides.size() - 1, 2 * form.faces.size());
    }
  }
}

TEST(BoundaryFaces, RefusesAThird) {
  for (const PointId shared : {0u, 500u}) {  // before and behind all other faces
    Elements elements = one(ElementType::hexahedron27, shared);
    for (const PointId first : {100u, 200u}) {
      Elements next = one(ElementType::hexahedron27, first);
      const ElementShape& form = shape(ElementType::hexahedron27);
      for (const std::uint8_t node : form.faces[0]) next.points[node] = shared + node;
      next.points[form.face_centre(0)] = shared + form.face_centre(0);
      elements.add(ElementType::hexahedron27, next.points);
    }
    test::expect_error(ErrorCode::invalid_argument, {"elements[2]", "face 0", "belongs to 3 elements"},
                       [&] { boundary_faces(elements); });
  }
}

TEST(FaceKey, OrderAndRepetitionDoNotMatter) {
  const PointId a[] = {5, 2, 9, 2}, b[] = {9, 5, 2};
  EXPECT_EQ(face_key(a), face_key(b));
}

}  // namespace
}  // namespace deform::elements_test
