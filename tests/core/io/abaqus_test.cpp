// SPDX-License-Identifier: GPL-3.0-or-later
// Abaqus: nodes, sets and surfaces, parts and included files, and what is written and refused.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <vector>

#include "core/io/mesh_file.h"
#include "core/quality/element_quality.h"
#include "tests/support/expect_error.h"

namespace deform::io::abaqus_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

// A cube with a pyramid on it and a prism beside it, all labels out of order.
const std::string text = R"(*HEADING
 ** a star in a heading, 1, 2, 3
** a comment
*Node, nset=all
 12, 0., 0., 0.
  5, 1.0D0
  7, 1., 1.,
 90000000,0,1,0,0,0,1
*NODE,NSET=Top,
  SYSTEM=R
1,,,1
2,1.,,1.0
3 ,  1. , 1.E0 , +1
4,0,1,1
*ELEMENT,TYPE=C3D8R,ELSET=Cube
1, 12,5,7,90000000,
   1,2,
   3,4
*node
8,.5,.5,2.
10,2,0,0
11,2,0,1
*Element, type = C3D5 , elset="The roof"
2, 1,2,3,4,8
*ELEMENT,TYPE=C3D6,ELSET=Cube
3,5,10,7,2,11,3
*ELEMENT,TYPE=S4R,ELSET=skin
20,12,90000000,7,5
21,1,2,3,4
*ELEMENT,TYPE=B31
30,8,10,
11
*ELEMENT,TYPE=CONN3D2,ELSET=skin
31,,8
*NSET,NSET=some,GENERATE
1,5,2
10,4000000000000000000,2
*NSET,NSET=more
 some, 12,
*NSET,NSET=roof nodes,ELSET=THE ROOF
*ELSET,ELSET=all of it
CUBE,2
*SURFACE,NAME=wet
1,S3
"the roof",S2
3,S1
*SURFACE,NAME=all,TYPE=ELEMENT
Cube,
*SURFACE,NAME=corner,TYPE=NODE
12,
TOP,1.
*SURFACE,NAME=plate
21,SPOS
20,E1
*BOUNDARY
all,1,3
*STEP
*END STEP
)";

const Group& group(const Mesh& mesh, const std::string& name) {
  const Group* found = mesh.find_group(name);
  if (found == nullptr) throw Error(ErrorCode::not_found, "no group " + name);
  return *found;
}

std::vector<PointId> corners(const Mesh& mesh, FaceId face) {
  const auto first = mesh.face_points.begin() + static_cast<std::ptrdiff_t>(mesh.face_offsets()[face]);
  return {first, first + mesh.face_sizes[face]};
}

TEST(Abaqus, ElementsSetsAndSurfaces) {
  const auto file = parse_mesh(text, "a.inp");
  EXPECT_EQ(file->format(), Format::abaqus);
  const auto mesh = file->mesh();
  ASSERT_EQ(mesh->point_count(), 11u);
  EXPECT_EQ(mesh->points[1], (Vec3{1, 0, 0}));
  EXPECT_EQ(mesh->points[3], (Vec3{0, 1, 0})) << "a normal follows the coordinates";
  EXPECT_EQ(mesh->points[4], (Vec3{0, 0, 1}));
  EXPECT_EQ(mesh->points[6], (Vec3{1, 1, 1}));
  EXPECT_THAT(file->elements()->types, ElementsAre(ElementType::hexahedron, ElementType::pyramid, ElementType::prism));
  EXPECT_EQ(element_quality(mesh->points, *file->elements()).inverted_elements, 0u);
  EXPECT_EQ(mesh->face_count(), 4u + 4 + 4);

  EXPECT_THAT(group(*mesh, "Top").points, ElementsAre(4, 5, 6, 7));
  EXPECT_THAT(group(*mesh, "some").points, ElementsAre(0, 1, 3, 4, 6, 9)) << "what is missing in a range is not in it";
  EXPECT_THAT(group(*mesh, "more").points, ElementsAre(0, 1, 3, 4, 6, 9));
  EXPECT_THAT(group(*mesh, "roof nodes").points, ElementsAre(4, 5, 6, 7, 8));
  EXPECT_THAT(group(*mesh, "The roof").points, ElementsAre(4, 5, 6, 7, 8));
  EXPECT_THAT(group(*mesh, "Cube").points, SizeIs(10));
  EXPECT_THAT(group(*mesh, "all of it").points, SizeIs(11));
  EXPECT_THAT(group(*mesh, "skin").faces, SizeIs(1));
  EXPECT_THAT(group(*mesh, "skin").points, ElementsAre(4, 5, 6, 7, 8)) << "an inner shell and a connector";

  const auto& wet = group(*mesh, "wet");
  ASSERT_THAT(wet.faces, SizeIs(3));
  EXPECT_THAT(corners(*mesh, wet.faces[0]), testing::UnorderedElementsAre(0, 1, 4, 5));
  EXPECT_THAT(corners(*mesh, wet.faces[1]), testing::UnorderedElementsAre(4, 5, 8));
  EXPECT_THAT(corners(*mesh, wet.faces[2]), testing::UnorderedElementsAre(1, 2, 9));
  EXPECT_THAT(group(*mesh, "all").faces, SizeIs(8)) << "free faces of cube and prism";
  EXPECT_THAT(group(*mesh, "pointZone:all").points, ElementsAre(0, 1, 2, 3)) << "a surface has the name";
  EXPECT_THAT(group(*mesh, "corner").points, ElementsAre(0, 4, 5, 6, 7));
  EXPECT_THAT(group(*mesh, "plate").points, ElementsAre(0, 3, 4, 5, 6, 7)) << "an edge and an inner face";
}

TEST(Abaqus, KeywordsGoOnBehindAComma) {
  const std::string nodes = "1,0,0,0\n2,1,0,0\n3,1,1,0\n", elements = "*ELEMENT, TYPE=S3\n1,1,2,3\n";
  const auto named = [&](const std::string& keyword) { return parse_mesh(keyword + nodes + elements, "a.inp")->mesh(); };
  EXPECT_THAT(group(*named("*NODE, NSET=all\n"), "all").points, ElementsAre(0, 1, 2));
  EXPECT_THAT(group(*named("*NODE,\nNSET=all\n"), "all").points, ElementsAre(0, 1, 2));
  EXPECT_THAT(group(*named("*NODE,\n** a comment\nSYSTEM=R,\n NSET=all\n"), "all").points, ElementsAre(0, 1, 2));
}

TEST(Abaqus, ACommaTooManyEndsBeforeTheNextKeyword) {
  for (const std::string& comment : {"", "** a comment\n"}) {
    const std::string text = "*HEADING,\n" + comment + "*NODE, NSET=all,\n" + comment +
                             "*NSET, NSET=some, GENERATE\n1,2\n*NODE,\n*NODE, NSET=more\n1,0,0,0\n2,1,0,0\n3,1,1,0\n" +
                             "*ELEMENT, TYPE=S3\n1,1,2,3\n*STEP,";
    const auto file = parse_mesh(text, "a.inp");
    const auto mesh = file->mesh();
    EXPECT_THAT(mesh->points, ElementsAre(Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{1, 1, 0}));
    EXPECT_THAT(group(*mesh, "some").points, ElementsAre(0, 1));
    EXPECT_THAT(group(*mesh, "more").points, ElementsAre(0, 1, 2));
    EXPECT_EQ(file->with_points(mesh->points), text);
  }
}

// What has no side of this number gives all of its nodes.
TEST(Abaqus, SidesOfShellsAndLines) {
  const std::string nodes = "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,.5,0,0\n";
  const std::string shell = "*ELEMENT,TYPE=S4\n1,1,2,3,4\n", line = "*ELEMENT,TYPE=B32\n2,1,5,2\n";
  const auto points_of = [&](const std::string& side) {
    const auto mesh = parse_mesh(nodes + shell + line + "*SURFACE,NAME=found\n" + side + "\n", "a.inp")->mesh();
    std::vector<PointId> points = group(*mesh, "found").points;
    std::sort(points.begin(), points.end());
    return points;
  };
  EXPECT_THAT(points_of("1,E1"), ElementsAre(0, 1));
  EXPECT_THAT(points_of("1,E4"), ElementsAre(0, 3));
  EXPECT_THAT(points_of("1,S3"), ElementsAre(0, 1));
  EXPECT_THAT(points_of("1,S6"), ElementsAre(0, 3));
  EXPECT_THAT(points_of("1,E5"), ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(points_of("1,S7"), ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(points_of("2,S1"), ElementsAre(0, 1, 4));
}

TEST(Abaqus, RefusesPointsThatDoNotFit) {
  const auto file = parse_mesh(text, "a.inp");
  Points points = file->mesh()->points;
  points[3][1] = std::numeric_limits<double>::quiet_NaN();
  test::expect_error(ErrorCode::invalid_argument, {"points[3]", "finite"}, [&] { (void)file->with_points(points); });
  points.pop_back();
  test::expect_error(ErrorCode::invalid_argument, {"points", "10", "11"}, [&] { (void)file->with_points(points); });
}

/// What one line becomes when the coordinates of `point` change; nothing else may.
void expect_line(std::size_t point, const Vec3& moved, const std::string& before, const std::string& after) {
  const auto file = parse_mesh(text, "a.inp");
  Points points = file->mesh()->points;
  points[point] = moved;
  std::string expected = text;
  ASSERT_NE(expected.find(before), std::string::npos);
  expected.replace(expected.find(before), before.size(), after);
  const std::string written = file->with_points(points);
  EXPECT_EQ(written, expected);
  const Vec3 back = parse_mesh(written, "a.inp")->mesh()->points[point];
  for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(back[k], moved[k], 1e-13 * std::abs(moved[k]));
}

TEST(Abaqus, OnlyCoordinatesChange) {
  const auto file = parse_mesh(text, "a.inp");
  EXPECT_EQ(file->with_points(file->mesh()->points), text);
  expect_line(0, {0, 0.25, 0}, " 12, 0., 0., 0.\n", " 12, 0., 0.25, 0.\n");
  expect_line(1, {1, 0, 3}, "  5, 1.0D0\n", "  5, 1.0D0,,3\n");
  expect_line(1, {2, 4, 3}, "  5, 1.0D0\n", "  5, 2,4,3\n");
  expect_line(2, {1, 1, 0.5}, "  7, 1., 1.,\n", "  7, 1., 1.,0.5\n");
  expect_line(3, {0, 1, -7}, "90000000,0,1,0,0,0,1\n", "90000000,0,1,-7,0,0,1\n");
  expect_line(4, {0.5, 0, 1}, "1,,,1\n", "1,0.5,,1\n");
  expect_line(6, {1, 1, 1e-20}, "3 ,  1. , 1.E0 , +1\n", "3 ,  1. , 1.E0 , 1e-20\n");
  // Abaqus reads 20 characters.
  expect_line(8, {-1e-5 / 3, 0.1 + 0.2, 2}, "8,.5,.5,2.\n", "8,-3.33333333333333e-6,0.30000000000000004,2.\n");
}

TEST(Abaqus, CommaAtTheEndOfANode) {
  const auto written = [](const std::string& line, const Vec3& point) {
    const auto file = parse_mesh("*NODE\n" + line + "\n", "a.inp");
    const std::string bytes = file->with_points(Points{point});
    EXPECT_EQ(parse_mesh(bytes, "a.inp")->mesh()->points[0], point);
    return bytes.substr(6);
  };
  EXPECT_EQ(written("1", {0, 0, 3}), "1,,,3\n");
  EXPECT_EQ(written("1,", {1, 2, 0}), "1,1,2\n");
  EXPECT_EQ(written("1, ,", {1, 2, 3}), "1,1 ,2,3\n");
  EXPECT_EQ(written("1 ,  \r", {0, 2, 0}), "1 ,,2  \r\n");
}

TEST(Abaqus, PartsAndInstances) {
  const std::string part = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n*ELEMENT,TYPE=CPS3,ELSET=body\n1,1,2,3\n";
  const std::string deck = "*PART,NAME=Plate\n" + part + "*END PART\n*PART,NAME=Other\n" + part +
                           "*Surface,NAME=side\n1,S2\n*END PART\n"
                           "*ASSEMBLY,NAME=Assembly\n*INSTANCE,NAME=Plate-1,PART=plate\n10.,0,0\n*END INSTANCE\n"
                           "*INSTANCE,NAME=Other-1,PART=Other\n0,0,1\n0,0,0,1,0,0,90\n*END INSTANCE\n"
                           "*NODE\n1,5,5,5\n"
                           "*NSET,NSET=tips,INSTANCE=Plate-1\n3,\n*NSET,NSET=tips,INSTANCE=other-1\n3\n"
                           "*NSET,NSET=_hidden,INTERNAL,INSTANCE=Plate-1\n1,2\n*NSET,NSET=point\n1\n"
                           "*ELSET,ELSET=_s,INTERNAL,INSTANCE=Plate-1\n1\n*SURFACE,NAME=front\n_s,SPOS\nOther-1.body,S1\n"
                           "*SURFACE,NAME=nodes,TYPE=NODE\nOther-1.2\n*END ASSEMBLY\n";
  const auto file = parse_mesh(deck, "a.inp");
  const auto mesh = file->mesh();
  ASSERT_EQ(mesh->point_count(), 7u);
  EXPECT_EQ(mesh->points[3], (Vec3{0, 0, 0})) << "points are those of the part";
  EXPECT_EQ(mesh->face_count(), 2u);
  EXPECT_THAT(group(*mesh, "Plate.body").faces, ElementsAre(0));
  EXPECT_THAT(group(*mesh, "Other.body").faces, ElementsAre(1));
  EXPECT_THAT(group(*mesh, "Other.side").points, ElementsAre(4, 5)) << "an edge";
  EXPECT_THAT(group(*mesh, "tips").points, ElementsAre(2, 5));
  EXPECT_THAT(group(*mesh, "point").points, ElementsAre(6));
  EXPECT_THAT(group(*mesh, "front").faces, ElementsAre(0));
  EXPECT_THAT(group(*mesh, "front").points, ElementsAre(3, 4));
  EXPECT_THAT(group(*mesh, "nodes").points, ElementsAre(4));
  EXPECT_EQ(mesh->find_group("_hidden"), nullptr);
  EXPECT_EQ(file->with_points(mesh->points), deck);

  const std::string own = "*PART,NAME=P\n*END PART\n*ASSEMBLY,NAME=A\n*INSTANCE,NAME=P-1,PART=P\n" + part +
                          "*END INSTANCE\n*INSTANCE,NAME=P-2,PART=P\n" + part + "*END INSTANCE\n*END ASSEMBLY\n";
  EXPECT_EQ(parse_mesh(own, "a.inp")->mesh()->point_count(), 6u) << "instances with nodes of their own";
  EXPECT_THAT(group(*parse_mesh("*PART,NAME=P\n" + part, "a.inp")->mesh(), "body").faces, ElementsAre(0))
      << "one part: no prefix";
}

/// Nodes amid edges as the figures of "Three-dimensional solid element library" number them.
TEST(Abaqus, QuadraticElements) {
  const std::vector<Vec3> cube = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
  struct Tested {
    const char* type;
    ElementType expected;
    std::vector<Vec3> corners;
    std::vector<std::array<std::size_t, 2>> between;  // corners from 1
    std::vector<std::size_t> first_side;
  };
  const Tested table[] = {
      {"C3D10M",
       ElementType::tetrahedron10,
       {cube[0], cube[1], cube[3], cube[4]},
       {{1, 2}, {2, 3}, {3, 1}, {1, 4}, {2, 4}, {3, 4}},
       {1, 5, 2, 6, 3, 7}},
      {"C3D15",
       ElementType::prism15,
       {cube[0], cube[1], cube[3], cube[4], cube[5], cube[7]},
       {{1, 2}, {2, 3}, {3, 1}, {4, 5}, {5, 6}, {6, 4}, {1, 4}, {2, 5}, {3, 6}},
       {1, 7, 2, 8, 3, 9}},
      {"C3D20RH",
       ElementType::hexahedron20,
       cube,
       {{1, 2}, {2, 3}, {3, 4}, {4, 1}, {5, 6}, {6, 7}, {7, 8}, {8, 5}, {1, 5}, {2, 6}, {3, 7}, {4, 8}},
       {1, 9, 2, 10, 3, 11, 4, 12}},
  };
  for (const Tested& tested : table) {
    SCOPED_TRACE(tested.type);
    std::vector<Vec3> points = tested.corners;
    for (const auto& edge : tested.between) {
      Vec3 middle;
      for (std::size_t k = 0; k < 3; ++k) middle[k] = (points[edge[0] - 1][k] + points[edge[1] - 1][k]) / 2;
      points.push_back(middle);
    }
    std::string deck = "*NODE\n", element = "1";
    for (std::size_t i = 0; i < points.size(); ++i) {
      deck += std::to_string(i + 1);
      for (const double c : points[i]) deck.append(",").append(testing::PrintToString(c));
      deck += "\n";
      element.append(i == 15 ? ",\n" : ",").append(std::to_string(i + 1));
    }
    deck += "*ELEMENT,TYPE=" + std::string(tested.type) + "\n" + element + "\n*SURFACE,NAME=base\n1,S1\n";
    const auto file = parse_mesh(deck, "a.inp");
    ASSERT_THAT(file->elements()->types, ElementsAre(tested.expected));
    const ElementShape& form = shape(tested.expected);
    const auto nodes = file->elements()->nodes(0);
    for (std::size_t e = 0; e < form.edges.size(); ++e) {
      const Vec3 &a = points[nodes[form.edges[e][0]]], &b = points[nodes[form.edges[e][1]]];
      EXPECT_EQ(points[nodes[form.corners + e]], (Vec3{(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2})) << "edge " << e;
    }
    EXPECT_EQ(element_quality(points, *file->elements()).inverted_elements, 0u);
    const auto& base = group(*file->mesh(), "base");
    ASSERT_THAT(base.faces, SizeIs(1));
    std::vector<PointId> expected;
    for (const std::size_t node : tested.first_side) expected.push_back(static_cast<PointId>(node - 1));
    EXPECT_THAT(corners(*file->mesh(), base.faces[0]), testing::UnorderedElementsAreArray(expected));
  }
}

class AbaqusIncludes : public testing::Test {
 protected:
  AbaqusIncludes() {
    fs::remove_all(folder_);
    fs::create_directories(folder_ / "in" / "parts");
    write_file(folder_ / "in" / "a.inp", main_);
    write_file(folder_ / "in" / "parts" / "nodes.inp", nodes_);
    write_file(folder_ / "in" / "elements.inp", "*ELEMENT,TYPE=S3\n1,1,2,3\n");
  }
  ~AbaqusIncludes() override { fs::remove_all(folder_); }

  const fs::path folder_ = fs::path(testing::TempDir()) / ("abaqus_" + std::to_string(::getpid()));
  const std::string main_ = "*NODE,NSET=n\n1,0,0,0\n*INCLUDE,INPUT=parts/nodes.inp\n3,0,1,0\n*Include, input=\"elements.inp\"\n";
  const std::string nodes_ = "** data lines only\n2,1,0,0\n";
};

TEST_F(AbaqusIncludes, AreReadAndWrittenBesideTheFile) {
  const auto file = read_mesh_file(folder_ / "in" / "a.inp");
  const auto mesh = file->mesh();
  EXPECT_EQ(mesh->points, (Points{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
  EXPECT_EQ(mesh->face_count(), 1u);
  EXPECT_THAT(group(*mesh, "n").points, ElementsAre(0, 1, 2));

  const Points moved = {{0, 0, 5}, {1, 0, 6}, {0, 1, 7}};
  write_mesh_file(*file, moved, folder_ / "out" / "b.inp");
  EXPECT_EQ(read_file(folder_ / "out" / "b.inp"),
            "*NODE,NSET=n\n1,0,0,5\n*INCLUDE,INPUT=parts/nodes.inp\n3,0,1,7\n*Include, input=\"elements.inp\"\n");
  EXPECT_EQ(read_file(folder_ / "out" / "parts" / "nodes.inp"), "** data lines only\n2,1,0,6\n");
  EXPECT_EQ(read_mesh_file(folder_ / "out" / "b.inp")->mesh()->points, moved);
}

TEST_F(AbaqusIncludes, TheFilesReadAreNotOverwritten) {
  const auto file = read_mesh_file(folder_ / "in" / "a.inp");
  Points moved = file->mesh()->points;
  moved[0] = {0, 0, 5};
  write_mesh_file(*file, moved, folder_ / "in" / "b.inp");
  EXPECT_THAT(read_file(folder_ / "in" / "b.inp"), HasSubstr("1,0,0,5\n*INC")) << "the included points are the same";
  EXPECT_THAT(file->with_points(moved), HasSubstr("1,0,0,5\n*INC"));
  moved[1] = {9, 9, 9};
  test::expect_error(ErrorCode::failed_precondition, {"nodes.inp", "the file that was read"},
                     [&] { write_mesh_file(*file, moved, folder_ / "in" / "c.inp"); });
  EXPECT_FALSE(fs::exists(folder_ / "in" / "c.inp"));
  EXPECT_EQ(read_file(folder_ / "in" / "parts" / "nodes.inp"), nodes_);
  test::expect_error(ErrorCode::failed_precondition, {"a.inp", "nodes stand in", "nodes.inp"}, [&] { file->with_points(moved); });
}

TEST_F(AbaqusIncludes, InputOfNodesAndElements) {
  write_file(folder_ / "in" / "e.csv", "1,1,2,3\n");
  write_file(folder_ / "in" / "d.inp", "*NODE,INPUT=parts/nodes.inp\n1,0,0,0\n3,0,1,0\n*ELEMENT,TYPE=S3,INPUT=e.csv\n");
  const auto mesh = read_mesh_file(folder_ / "in" / "d.inp")->mesh();
  EXPECT_EQ(mesh->points[0], (Vec3{1, 0, 0}));
  EXPECT_EQ(mesh->face_count(), 1u);
}

TEST_F(AbaqusIncludes, WhatIsWrongWithThem) {
  test::expect_error(ErrorCode::invalid_argument, {"a.inp: line 3", "nodes.inp", "in memory"},
                     [&] { parse_mesh(main_, "a.inp"); });
  write_file(folder_ / "in" / "a.inp", "*INCLUDE,INPUT=nothing.inp\n");
  test::expect_error(ErrorCode::invalid_argument, {"a.inp: line 1", "nothing.inp"},
                     [&] { read_mesh_file(folder_ / "in" / "a.inp"); });
  write_file(folder_ / "in" / "a.inp", "*INCLUDE,INPUT=a.inp\n");
  test::expect_error(ErrorCode::invalid_argument, {"a.inp: line 1", "deep"}, [&] { read_mesh_file(folder_ / "in" / "a.inp"); });
  write_file(folder_ / "in" / "a.inp", "*NODE\n*INCLUDE,INPUT=elements.inp\n1,0,0,x\n");
  test::expect_error(ErrorCode::invalid_argument, {"a.inp: line 3", "node of an element", "\"x\""},
                     [&] { read_mesh_file(folder_ / "in" / "a.inp"); });
}

TEST(Abaqus, RefusesWhatIsWrong) {
  const std::string nodes = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n";
  const std::string tetrahedron = nodes + "*ELEMENT,TYPE=C3D4\n1,1,2,3,4\n";
  const std::pair<std::string, std::vector<const char*>> table[] = {
      {"", {"no nodes"}},
      {"solid\n", {"no nodes"}},
      {"*NODE\n1 0 0 0\n", {"line 2", "number of a node", "\"1 0 0 0\""}},
      {"*NODE\n1,0,a,0\n", {"line 2", "a coordinate", "\"a\""}},
      {"*NODE\n1,0,1e999,0\n", {"finite", "\"1e999\""}},
      {"*NODE\n1,0,nan,0\n", {"finite", "\"nan\""}},
      {"*NODE\n1,0\n1,1\n", {"line 3", "node 1 is there already"}},
      {"*NODE,SYSTEM=C\n", {"line 1", "\"C\"", "rectangular"}},
      {"*SYSTEM\n0,0,0\n", {"line 2", "*SYSTEM"}},
      {"*NODE\n1,0\n*NGEN\n1,5\n", {"line 3", "*NGEN"}},
      {nodes + "*ELEMENT\n", {"line 6", "without TYPE"}},
      {nodes + "*ELEMENT,TYPE=C3D27\n", {"line 6", "\"C3D27\"", "not supported"}},
      {nodes + "*ELEMENT,TYPE=C3D15V\n", {"\"C3D15V\"", "not supported"}},
      {nodes + "*ELEMENT,TYPE=C3D4\n1,1,2,3\n", {"line 7", "element 1 has 3 nodes", "4"}},
      {nodes + "*ELEMENT,TYPE=C3D4\n1,1,2,3,4,4\n", {"line 7", "more than 4 nodes"}},
      {nodes + "*ELEMENT,TYPE=C3D4\n1,1,2,3,5\n", {"line 7", "element 1 has the node 5"}},
      {nodes + "*ELEMENT,TYPE=C3D4\n1,1,2,3,x\n", {"line 7", "\"x\""}},
      {tetrahedron + "1,1,2,3,4\n", {"line 8", "element 1 is there already"}},
      {tetrahedron + "*NSET\n", {"line 8", "without NSET"}},
      {tetrahedron + "*NSET,NSET=a\n7\n", {"line 9", "no node 7"}},
      {tetrahedron + "*NSET,NSET=a\nb\n", {"line 9", "no node set \"b\""}},
      {tetrahedron + "*NSET,NSET=a,ELSET=b\n", {"line 8", "no element set \"b\""}},
      {tetrahedron + "*NSET,NSET=a\nA\n", {"line 9", "names itself"}},
      {tetrahedron + "*NSET,NSET=a,GENERATE\n5,1\n", {"line 9", "from 5 to 1"}},
      {tetrahedron + "*NSET,NSET=a,GENERATE\n1,5,0\n", {"steps of 0"}},
      {tetrahedron + "*NSET,NSET=a,INSTANCE=b\n1\n", {"line 8", "no instance \"b\""}},
      {tetrahedron + "*SURFACE,NAME=a\n1,S5\n", {"line 9", "element 1", "tetrahedron", "\"S5\""}},
      {tetrahedron + "*SURFACE,NAME=a\n2,S1\n", {"line 9", "no element 2"}},
      {tetrahedron + "*INCLUDE\n", {"line 8", "INCLUDE", "name of a file"}},
  };
  for (const auto& [bytes, message] : table) {
    SCOPED_TRACE(bytes);
    std::vector<const char*> parts = message;
    parts.push_back("a.inp: ");
    test::expect_error(ErrorCode::invalid_argument, parts, [&, &input = bytes] { parse_mesh(input, "a.inp"); });
  }
}

}  // namespace
}  // namespace deform::io::abaqus_test
