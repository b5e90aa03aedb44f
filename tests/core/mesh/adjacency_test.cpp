// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/adjacency.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include "tests/core/mesh/named_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::adjacency_test {
namespace {

using test::mask_of;
using test::selected;
using testing::ElementsAre;
using testing::IsEmpty;

TEST(AdjacencyTest, ListsTheFacesOfAPointAscendingAndOnce) {
  const Mesh mesh = test::one_ring();
  const Adjacency adjacency(mesh);
  EXPECT_THAT(adjacency.faces_of(0), ElementsAre(0, 1, 2, 3, 4, 5));
  EXPECT_THAT(adjacency.faces_of(1), ElementsAre(0, 5));
  EXPECT_THAT(adjacency.points_of(5), ElementsAre(0, 6, 1));

  const Mesh repeating = test::repeated_corner();
  EXPECT_THAT(Adjacency(repeating).faces_of(1), ElementsAre(0, 1));
}

TEST(AdjacencyTest, IsolatedPointsHaveNoFaces) {
  const Mesh mesh = test::with_loose_points();
  const Adjacency adjacency(mesh);
  EXPECT_THAT(adjacency.faces_of(3), IsEmpty());
  EXPECT_THAT(adjacency.faces_of(4), IsEmpty());
}

TEST(AdjacencyTest, GrowsRingByRingAcrossWholeFaces) {
  const Mesh mesh = test::quad_grid(6, 6);
  const Adjacency adjacency(mesh);
  const auto seed = mask_of(mesh, {24});  // (3, 3), the middle
  for (int rings = 0; rings <= 3; ++rings) {
    // Points of one quad are neighbours across its diagonal too: squares of side 2 rings + 1.
    EXPECT_EQ(selected(adjacency.grow(seed, rings)).size(), static_cast<std::size_t>((2 * rings + 1) * (2 * rings + 1)));
  }
  EXPECT_THAT(selected(adjacency.grow(seed, 1)), ElementsAre(16, 17, 18, 23, 24, 25, 30, 31, 32));
  EXPECT_EQ(selected(adjacency.grow(seed, 1000)).size(), mesh.point_count());
}

TEST(AdjacencyTest, TwoStepsAreTwiceOneStep) {
  const Mesh mesh = test::quad_grid(9, 4);
  const Adjacency adjacency(mesh);
  const auto seed = mask_of(mesh, {0, 27});
  EXPECT_EQ(adjacency.grow(seed, 2), adjacency.grow(adjacency.grow(seed, 1), 1));
}

TEST(AdjacencyTest, UnlimitedGrowthStaysInItsComponent) {
  const Mesh mesh = test::with_loose_points();
  const Adjacency adjacency(mesh);
  EXPECT_THAT(selected(adjacency.grow(mask_of(mesh, {1}), -1)), ElementsAre(0, 1, 2));
  EXPECT_THAT(selected(adjacency.grow(mask_of(mesh, {3}), -1)), ElementsAre(3));
  EXPECT_THAT(selected(adjacency.grow(mask_of(mesh, {}), -1)), IsEmpty());
}

TEST(AdjacencyTest, RefusesASeedOfTheWrongSize) {
  const Mesh mesh = test::tetrahedron();
  test::expect_error(ErrorCode::invalid_argument, {"3 entries", "4 points"},
                     [&] { Adjacency(mesh).grow(std::vector<char>(3, 1), 1); });
}

struct Named {
  const char* name;
  Mesh (*mesh)();
  std::vector<PointId> boundary, non_manifold;
};

std::ostream& operator<<(std::ostream& out, const Named& c) { return out << c.name; }

class NamedMeshTest : public testing::TestWithParam<Named> {};

TEST_P(NamedMeshTest, BoundaryPoints) {
  const Mesh mesh = GetParam().mesh();
  EXPECT_EQ(selected(Adjacency(mesh).boundary_points()), GetParam().boundary);
}

TEST_P(NamedMeshTest, NonManifoldPoints) {
  const Mesh mesh = GetParam().mesh();
  EXPECT_EQ(selected(Adjacency(mesh).non_manifold_points()), GetParam().non_manifold);
}

/// Two triangles that share only point 0, both open fans.
Mesh bow_tie() { return test::make_mesh({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {-1, 0, 0}, {-1, -1, 0}}, {{0, 1, 2}, {0, 3, 4}}); }
/// A face of two corners next to a triangle: it has no edges, and no disc around its points.
Mesh with_two_gon() { return test::make_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}, {{0, 1, 2}, {1, 3}}); }
Mesh three_by_one() { return test::quad_grid(3, 1); }

INSTANTIATE_TEST_SUITE_P(All, NamedMeshTest,
                         testing::Values(Named{"OneRing", test::one_ring, {1, 2, 3, 4, 5, 6}, {}},
                                         Named{"OpenCone", test::open_cone, {0, 1, 2, 3, 4}, {}},
                                         Named{"Tetrahedron", test::tetrahedron, {}, {}},
                                         Named{"QuadStrip", three_by_one, {0, 1, 2, 3, 4, 5, 6, 7}, {}},
                                         Named{"TwoFans", test::two_fans, {1, 2, 3, 4, 5, 6}, {0}},
                                         Named{"BowTie", bow_tie, {0, 1, 2, 3, 4}, {0}},
                                         Named{"NonManifoldEdge", test::non_manifold_edge, {0, 1, 2, 3, 4}, {0, 1}},
                                         Named{"FlippedNeighbour", test::flipped_neighbour, {0, 1, 2, 3}, {0, 1}},
                                         Named{"RepeatedCorner", test::repeated_corner, {0, 1, 2}, {1, 3}},
                                         Named{"TwoGon", with_two_gon, {0, 1, 2}, {1, 3}},
                                         Named{"LoosePoints", test::with_loose_points, {0, 1, 2}, {3, 4}}),
                         [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace
}  // namespace deform::adjacency_test
