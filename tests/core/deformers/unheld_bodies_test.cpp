// SPDX-License-Identifier: GPL-3.0-or-later
// Which bodies of a mesh nothing holds, and what is said about them.
#include "core/deformers/unheld_bodies.h"

#include <gtest/gtest.h>

#include <array>

#include "core/base/vectors.h"
#include "core/mesh/elements.h"
#include "tests/core/deformers/shapes.h"

namespace deform::unheld_bodies_test {
namespace {

/// The sheet, and further ones of 5 x 4 points above it.
Mesh sheets(std::size_t further) {
  Mesh mesh = test::bumpy_sheet(20, 10);
  for (std::size_t s = 1; s <= further; ++s) {
    const Mesh small = test::bumpy_sheet(4 + s, 4);
    const auto first = static_cast<PointId>(mesh.point_count());
    for (const Vec3& x : small.points) mesh.points.push_back(x + Vec3{0, 0, static_cast<double>(s)});
    mesh.face_sizes.insert(mesh.face_sizes.end(), small.face_sizes.begin(), small.face_sizes.end());
    for (const PointId point : small.face_points) mesh.face_points.push_back(first + point);
  }
  return mesh;
}

SelectedRegions regions_on(const Mesh& mesh, const Setup& setup) { return validate(setup, mesh); }

/// Boxes that hold the first sheet only.
Setup first_sheet() {
  Setup setup;
  setup.handles = {{"end", test::box({1.7, -1, -0.5}, {3, 2, 0.5})}};
  setup.fixed = {test::box({-1, -1, -0.5}, {0.3, 2, 0.5})};
  return setup;
}

TEST(UnheldBodies, AreNamedByPointsAndPlace) {
  const Mesh mesh = sheets(2);
  const auto bodies = unheld_bodies(mesh, regions_on(mesh, first_sheet()));
  ASSERT_EQ(bodies.size(), 2u);
  EXPECT_EQ(bodies[0].points, 20u);
  EXPECT_EQ(bodies[0].first, 200u);
  EXPECT_EQ(bodies[1].points, 24u);
  EXPECT_EQ(bodies[1].first, 220u);
  EXPECT_NEAR(bodies[1].centre[0], 1, 1e-12);
  EXPECT_NEAR(bodies[1].centre[1], 0.5, 1e-12);
  EXPECT_NEAR(bodies[1].centre[2], 2, 0.1);
  const std::string note = unheld_bodies_note(mesh, regions_on(mesh, first_sheet()));
  EXPECT_NE(note.find("2 bodies, the largest of 24 points around (1, 0.5, "), std::string::npos) << note;
  EXPECT_NE(note.find("from point 220 on"), std::string::npos) << note;
  const Mesh one = sheets(1);
  EXPECT_EQ(unheld_bodies_note(one, regions_on(one, first_sheet())).rfind("A body of 20 points around (1, 0.5, ", 0), 0u);
}

TEST(UnheldBodies, AreNoneWhereEachHasAPointInARegion) {
  const Mesh mesh = sheets(2);
  deform::Setup setup = test::sheet_setup();
  EXPECT_EQ(unheld_bodies(mesh, regions_on(mesh, setup)).size(), 1u);  // its boxes reach the first of the further sheets
  setup.fixed.push_back({Region::Ids{{243}}});
  EXPECT_TRUE(unheld_bodies(mesh, regions_on(mesh, setup)).empty());
  EXPECT_EQ(unheld_bodies_note(mesh, regions_on(mesh, setup)), "");
}

// Seams of meshes whose points are doubled there, single points, and points without faces.
TEST(UnheldBodies, AreWhatIsApart) {
  Mesh mesh = sheets(1);
  mesh.points[200] = mesh.points[5];
  EXPECT_TRUE(unheld_bodies(mesh, regions_on(mesh, first_sheet())).empty());
  mesh = sheets(0);
  mesh.points.push_back({0, 0, 5});
  EXPECT_TRUE(unheld_bodies(mesh, regions_on(mesh, first_sheet())).empty());
  mesh = sheets(1);
  mesh.face_sizes.clear();
  mesh.face_points.clear();
  EXPECT_TRUE(unheld_bodies(mesh, regions_on(mesh, first_sheet())).empty());
}

// With several methods any of them may hold a body; control points hold no points.
TEST(UnheldBodies, OfSeveralMethods) {
  const Mesh mesh = sheets(1);
  SelectedRegions all = regions_on(mesh, first_sheet()), second;
  all.stages = {all, second};
  EXPECT_EQ(unheld_bodies(mesh, all).size(), 1u);
  all.stages[1].handles = {{210}};
  EXPECT_TRUE(unheld_bodies(mesh, all).empty());
  all.stages[1] = {};
  all.stages[1].of = SelectedRegions::Of::control_points;
  EXPECT_TRUE(unheld_bodies(mesh, all).empty());
}

// The cells of a volume mesh join what its boundary faces do not.
TEST(UnheldBodies, AreJoinedByCells) {
  Mesh mesh = sheets(1);
  Elements elements;
  elements.add(ElementType::tetrahedron, std::array<PointId, 4>{0, 1, 20, 200});
  mesh.elements = std::make_shared<const Elements>(std::move(elements));
  EXPECT_TRUE(unheld_bodies(mesh, regions_on(mesh, first_sheet())).empty());
}

}  // namespace
}  // namespace deform::unheld_bodies_test
