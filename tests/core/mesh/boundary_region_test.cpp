// SPDX-License-Identifier: GPL-3.0-or-later
// The region `boundary`: the surface of volume meshes, counted by brute force from the definition.
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "core/mesh/region.h"
#include "tests/core/mesh/polyhedral.h"
#include "tests/core/mesh/straight_elements.h"
#include "tests/support/expect_error.h"

namespace deform::boundary_region_test {
namespace {

using Ids = std::vector<PointId>;

Ids boundary_of(const Mesh& mesh) { return select({Region::Boundary{}}, mesh, "fixed[0]"); }

/// (n + 1)^3 points, and the elements of every brick as `split` makes them.
template <typename Split>
Mesh bricks(std::size_t n, const Split& split) {
  Mesh mesh;
  const auto at = [&](std::size_t i, std::size_t j, std::size_t k) {
    return static_cast<PointId>(i + (n + 1) * (j + (n + 1) * k));
  };
  Elements elements;
  for (std::size_t k = 0; k <= n; ++k) {
    for (std::size_t j = 0; j <= n; ++j) {
      for (std::size_t i = 0; i <= n; ++i) {
        mesh.points.push_back({static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)});
        if (i == n || j == n || k == n) continue;
        split(Ids{at(i, j, k), at(i + 1, j, k), at(i + 1, j + 1, k), at(i, j + 1, k), at(i, j, k + 1), at(i + 1, j, k + 1),
                  at(i + 1, j + 1, k + 1), at(i, j + 1, k + 1)},
              elements);
      }
    }
  }
  mesh.elements = std::make_shared<const Elements>(std::move(elements));
  return mesh;
}

void as_hexahedron(const Ids& corners, Elements& elements) { elements.add(ElementType::hexahedron, corners); }

/// Kuhn's six tetrahedra around the diagonal, which fit together from brick to brick.
void as_tetrahedra(const Ids& c, Elements& elements) {
  for (const auto& [a, b] : {std::pair{1, 2}, {2, 3}, {3, 7}, {7, 4}, {4, 5}, {5, 1}}) {
    elements.add(ElementType::tetrahedron, Ids{c[0], c[static_cast<std::size_t>(a)], c[static_cast<std::size_t>(b)], c[6]});
  }
}

/// The definition: points of faces that one element has, faces being the same when their points are.
Ids by_definition(const Elements& elements) {
  std::map<std::set<PointId>, int> uses;
  for (std::size_t e = 0; e < elements.size(); ++e) {
    for (const auto& face : shape(elements.types[e]).faces) {
      std::set<PointId> points;
      for (const auto node : face) points.insert(elements.nodes(e)[node]);
      ++uses[points];
    }
  }
  std::set<PointId> found;
  for (const auto& [points, count] : uses) {
    if (count == 1) found.insert(points.begin(), points.end());
  }
  return {found.begin(), found.end()};
}

TEST(BoundaryRegion, OfElementsIsThePointsOfFacesOfOneElement) {
  for (const std::size_t n : {1U, 2U, 5U}) {
    const std::size_t inside = (n - 1) * (n - 1) * (n - 1);
    for (const auto& mesh : {bricks(n, as_hexahedron), bricks(n, as_tetrahedra)}) {
      EXPECT_EQ(boundary_of(mesh).size(), mesh.point_count() - inside) << n;
      EXPECT_EQ(boundary_of(mesh), by_definition(*mesh.elements)) << n;
    }
  }
}

TEST(BoundaryRegion, OfPolyhedraIsThePointsOfFacesOfOneCell) {
  for (const std::size_t n : {1U, 3U, 4U}) {
    for (auto mesh : {bricks(n, as_hexahedron), bricks(n, as_tetrahedra)}) {
      const Ids expected = by_definition(*mesh.elements);
      auto cells = test::by_faces(*mesh.elements);
      cells.empty_faces.assign(cells.face_count(), 0);
      cells.empty_faces.back() = 1;  // of a patch of type "empty": it has one cell all the same
      mesh.elements = nullptr;
      mesh.cells = std::make_shared<const PolyhedralCells>(std::move(cells));
      EXPECT_EQ(boundary_of(mesh), expected) << n;
    }
  }
}

TEST(BoundaryRegion, HasTheMidNodesOfQuadraticElements) {
  Mesh mesh;
  mesh.points = straight_elements().at(ElementType::hexahedron27);
  Elements elements;
  Ids nodes(27);
  for (PointId i = 0; i < 27; ++i) nodes[i] = i;
  elements.add(ElementType::hexahedron27, nodes);
  mesh.elements = std::make_shared<const Elements>(std::move(elements));
  nodes.pop_back();  // the one in the middle
  EXPECT_EQ(boundary_of(mesh), nodes);
}

TEST(BoundaryRegion, KeepsBoxesFromTakingTheInside) {
  const Mesh mesh = bricks(4, as_hexahedron);
  const Region box{Region::InBox{{-1, -1, -1}, {5, 5, 2}}};
  const Ids both = select({Region::Intersection{{box, {Region::Boundary{}}}}}, mesh, "x");
  EXPECT_EQ(select(box, mesh, "x").size(), 75U);
  EXPECT_EQ(both.size(), 25U + 2 * 16U);
  for (const PointId id : both) {
    const Vec3& p = mesh.points[id];
    EXPECT_TRUE(p[2] == 0 || p[0] == 0 || p[0] == 4 || p[1] == 0 || p[1] == 4);
  }
}

TEST(BoundaryRegion, OfAMeshWithoutCellsIsThePointsOfItsFaces) {
  Mesh mesh;
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {9, 9, 9}, {1, 1, 0}, {0, 1, 0}};
  mesh.face_sizes = {3, 3};
  mesh.face_points = {0, 1, 3, 0, 3, 4};
  EXPECT_EQ(boundary_of(mesh), (Ids{0, 1, 3, 4}));
  mesh.face_sizes.clear();
  mesh.face_points.clear();
  EXPECT_EQ(boundary_of(mesh), Ids());
}

TEST(BoundaryRegion, SaysWhereElementsOverlap) {
  Mesh mesh = bricks(1, as_hexahedron);
  Elements elements = *mesh.elements;
  for (int copy = 0; copy < 2; ++copy) elements.add(ElementType::hexahedron, mesh.elements->nodes(0));
  mesh.elements = std::make_shared<const Elements>(std::move(elements));
  test::expect_error(ErrorCode::invalid_argument, {"fixed[0]: boundary: "}, [&] { boundary_of(mesh); });
}

TEST(NoPointText, SaysTheBoxInTheFewestDigits) {
  Mesh mesh;
  mesh.points = {{0.1, -1, 1e-7}, {0.30000000000000004, 2.5, 1e22}};
  EXPECT_EQ(no_point_text(mesh),
            "its region contains no point; the model's box is [0.1, -1, 1e-07] to [0.30000000000000004, 2.5, 1e+22]");
}

}  // namespace
}  // namespace deform::boundary_region_test
