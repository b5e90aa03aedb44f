// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/mesh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <memory>

#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::mesh_test {
namespace {

using test::expect_error;
using testing::ElementsAre;

TEST(MeshTest, FaceOffsetsAddUpTheSizes) {
  Mesh mesh = test::tetrahedron();
  mesh.face_sizes.push_back(4);
  mesh.face_points.insert(mesh.face_points.end(), {0, 1, 2, 3});
  EXPECT_THAT(mesh.face_offsets(), ElementsAre(0, 3, 6, 9, 12, 16));
  EXPECT_THAT(Mesh().face_offsets(), ElementsAre(0));
}

TEST(MeshTest, ViewsCellsOfEitherKind) {
  Mesh mesh = test::tetrahedron();
  EXPECT_FALSE(mesh.cells_view().any());
  PolyhedralCells cells;
  cells.cell_count = 1;
  cells.face_offsets = {0, 3, 6, 9, 12};
  cells.face_points = {0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3};
  cells.owner = {0, 0, 0, 0};
  cells.neighbour = {7};
  cells.empty_faces = {0, 1, 0, 1};
  mesh.cells = std::make_shared<PolyhedralCells>(cells);
  CellsView view = mesh.cells_view();
  EXPECT_TRUE(view.element_types.empty());
  EXPECT_TRUE(view.element_points.empty());
  EXPECT_EQ(view.cell_count, 1u);
  EXPECT_THAT(view.face_offsets, ElementsAre(0, 3, 6, 9, 12));
  EXPECT_THAT(view.face_points, ElementsAre(0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3));
  EXPECT_THAT(view.owner, ElementsAre(0, 0, 0, 0));
  EXPECT_THAT(view.neighbour, ElementsAre(7));
  EXPECT_THAT(view.empty_faces, ElementsAre(0, 1, 0, 1));
  mesh.cells.reset();
  Elements elements;
  elements.add(ElementType::tetrahedron, std::vector<PointId>{0, 1, 2, 3});
  mesh.elements = std::make_shared<Elements>(elements);
  view = mesh.cells_view();
  EXPECT_THAT(view.element_types, ElementsAre(static_cast<std::uint8_t>(ElementType::tetrahedron)));
  EXPECT_THAT(view.element_points, ElementsAre(0, 1, 2, 3));
  EXPECT_EQ(view.cell_count, 0u);
}

TEST(MeshTest, FindsGroupsByName) {
  Mesh mesh = test::tetrahedron();
  mesh.groups = {{"a", {0}, {}}, {"b", {}, {1, 2}}};
  ASSERT_NE(mesh.find_group("b"), nullptr);
  EXPECT_THAT(mesh.find_group("b")->faces, ElementsAre(1, 2));
  EXPECT_EQ(mesh.find_group("B"), nullptr);
}

TEST(MeshTest, EverythingThatIsOnlyUglyIsValid) {
  Mesh mesh = test::with_loose_points();
  mesh.face_sizes.insert(mesh.face_sizes.end(), {1, 2, 3});
  mesh.face_points.insert(mesh.face_points.end(), {0, 1, 1, 2, 2, 2});
  mesh.groups = {{"empty", {}, {}}, {"twice", {1, 1}, {0, 0}}};
  EXPECT_NO_THROW(mesh.validate());
}

TEST(MeshTest, TakesSizesUpToTheLimitsAndSinglePlaces) {
  for (const double unit : {1e-39, 1e39, 0.0}) {
    Mesh mesh = test::tetrahedron();
    for (Vec3& x : mesh.points) {
      for (double& c : x) c = unit * std::clamp(c, -1.0, 1.0);
    }
    EXPECT_NO_THROW(mesh.validate()) << unit;
    for (Vec3& x : mesh.points) x[0] += 1;
    EXPECT_NO_THROW(mesh.validate()) << unit << " off the origin";
  }
}

struct BadMesh {
  const char* name;
  void (*spoil)(Mesh&);
  std::vector<const char*> message;
};

std::ostream& operator<<(std::ostream& out, const BadMesh& c) { return out << c.name; }

class BadMeshTest : public testing::TestWithParam<BadMesh> {};

TEST_P(BadMeshTest, IsRefusedByFieldIndexAndLimit) {
  Mesh mesh = test::tetrahedron();
  mesh.groups = {{"top", {0, 1}, {2, 3}}};
  mesh.validate();
  GetParam().spoil(mesh);
  expect_error(ErrorCode::invalid_argument, GetParam().message, [&] { mesh.validate(); });
}

INSTANTIATE_TEST_SUITE_P(
    All, BadMeshTest,
    testing::Values(
        BadMesh{"NoPoints", [](Mesh& m) { m = {}; }, {"points", "at least one"}},
        BadMesh{"NaN", [](Mesh& m) { m.points[2][1] = std::numeric_limits<double>::quiet_NaN(); }, {"points[2]", "coordinate y"}},
        BadMesh{"Infinite",
                [](Mesh& m) { m.points[3][2] = -std::numeric_limits<double>::infinity(); },
                {"points[3]", "coordinate z"}},
        BadMesh{"Huge", [](Mesh& m) { m.points[2][1] = 1e308; }, {"points[2]", "coordinate y is 1e+308", "the limit is 1e+40"}},
        BadMesh{"HugeAndNegative", [](Mesh& m) { m.points[3][0] = -1.1e40; }, {"points[3]", "x is -1.1e+40", "1e+40"}},
        BadMesh{"Tiny",
                [](Mesh& m) {
                  for (Vec3& x : m.points) x = {2e-41 * x[0], 4e-41 * x[1], 1e-160 * x[2]};
                },
                {"points: their bounding box is", "e-41 long", "1e-40", "unit"}},
        BadMesh{"TinyAndFarFromNothing",
                [](Mesh& m) {
                  for (Vec3& x : m.points) x = {0, 0, 1e-160 * x[2]};
                },
                {"points: their bounding box is", "e-160 long"}},
        BadMesh{"CornerOutOfRange", [](Mesh& m) { m.face_points[5] = 4; }, {"face_points[5]", "point 4", "4 points"}},
        BadMesh{"CornerHuge", [](Mesh& m) { m.face_points[0] = ~0U; }, {"face_points[0]", "4294967295"}},
        BadMesh{"SizesTooLarge", [](Mesh& m) { m.face_sizes[0] = 4; }, {"face_sizes", "13", "12"}},
        BadMesh{"SizesTooFew", [](Mesh& m) { m.face_sizes.pop_back(); }, {"face_sizes", "9", "12"}},
        BadMesh{"EmptyFace", [](Mesh& m) { m.face_sizes[1] = 0; }, {"face_sizes[1]", "at least one corner"}},
        BadMesh{"GroupPoint", [](Mesh& m) { m.groups[0].points[1] = 4; }, {"group \"top\"", "points[1]", "point 4", "4 points"}},
        BadMesh{"GroupFace", [](Mesh& m) { m.groups[0].faces[0] = 9; }, {"group \"top\"", "faces[0]", "face 9", "4 faces"}},
        BadMesh{"UnnamedGroup", [](Mesh& m) { m.groups[0].name.clear(); }, {"groups[0]", "empty"}},
        BadMesh{"RepeatedGroup",
                [](Mesh& m) {
                  m.groups.push_back({"top", {}, {}});
                },
                {"groups[1]", "\"top\"", "twice"}}),
    [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace
}  // namespace deform::mesh_test
