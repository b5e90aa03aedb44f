// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <sstream>

#include "core/io/mesh_file.h"
#include "tests/core/io/text_diff.h"

namespace deform::io::obj_test {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

const std::string square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

std::shared_ptr<const Mesh> read(const std::string& text) {
  auto mesh = parse_mesh(text, "test.obj")->mesh();
  mesh->validate();
  return mesh;
}

std::vector<std::string> names(const Mesh& mesh) {
  std::vector<std::string> list;
  for (const Group& group : mesh.groups) list.push_back(group.name);
  return list;
}

TEST(ObjTest, PointsAndFacesInFileOrder) {
  const auto mesh = read("# a square\n" + square + "v 1 0 0\nf 1 2 3 4\nf 5 1 3\n");
  ASSERT_EQ(mesh->point_count(), 5U);  // the coincident fifth point stays
  EXPECT_EQ(mesh->points[2], (Vec3{1, 1, 0}));
  EXPECT_THAT(mesh->face_sizes, ElementsAre(4, 3));
  EXPECT_THAT(mesh->face_points, ElementsAre(0, 1, 2, 3, 4, 0, 2));
  EXPECT_THAT(mesh->groups, IsEmpty());
}

TEST(ObjTest, EveryFormOfACorner) {
  const auto mesh =
      read(square + "vt 0 0\nvn 0 0 1\nf 1/1 2/1 3/1\nf 1//1 2//1 3//1\nf 1/1/1 2/1/1 3/1/1\nf 1// 2// 3//\nf 1/ 2/ 3/\n");
  EXPECT_THAT(mesh->face_sizes, ElementsAre(3, 3, 3, 3, 3));
  for (std::size_t i = 0; i < 15; ++i) EXPECT_EQ(mesh->face_points[i], i % 3);
}

TEST(ObjTest, RelativeIndicesCountFromTheLine) {
  const auto mesh = read("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 1 1 0\nf -1/-1/-1 -2//-2 -3/-3\n");
  EXPECT_THAT(mesh->face_points, ElementsAre(0, 1, 2, 3, 2, 1));
}

TEST(ObjTest, FacesMayReferToLaterVertices) {
  EXPECT_THAT(read("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n")->face_points, ElementsAre(0, 1, 2));
}

TEST(ObjTest, GroupsObjectsAndMaterials) {
  const auto mesh = read(
      square + "o car body\ng roof left\nusemtl red\nf 1 2 3\ng roof\nusemtl blue\nf 1 3 4\ng\nf 2 3 4\nusemtl red\nf 1 2 4\n");
  EXPECT_THAT(names(*mesh), ElementsAre("car body", "roof", "left", "red", "blue"));
  EXPECT_THAT(mesh->find_group("car body")->faces, ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(mesh->find_group("roof")->faces, ElementsAre(0, 1));
  EXPECT_THAT(mesh->find_group("left")->faces, ElementsAre(0));
  EXPECT_THAT(mesh->find_group("red")->faces, ElementsAre(0, 3));
  EXPECT_THAT(mesh->find_group("blue")->faces, ElementsAre(1, 2));
}

TEST(ObjTest, NamesOfDifferentKindsDoNotClash) {
  // The object "a" is the same as the group; the material "a" is not; the group "material:a" is in its way.
  const auto mesh = read(square + "o a\ng a material:a\nf 1 2 3\nusemtl a\nf 1 3 4\n");
  EXPECT_THAT(names(*mesh), ElementsAre("a", "material:a", "material:a_2"));
  EXPECT_THAT(mesh->find_group("a")->faces, ElementsAre(0, 1));
  EXPECT_THAT(mesh->find_group("material:a_2")->faces, ElementsAre(1));
}

TEST(ObjTest, AnObjectWithOtherFacesThanTheGroupOfItsName) {
  const auto mesh = read(square + "o a\nf 1 2 3\ng a\nf 1 3 4\n");
  EXPECT_THAT(names(*mesh), ElementsAre("object:a", "a"));
  EXPECT_THAT(mesh->find_group("object:a")->faces, ElementsAre(0, 1));
}

TEST(ObjTest, EmptyNamesAndEmptyGroupsAreNoGroups) {
  EXPECT_THAT(read(square + "usemtl \no\ng unused\ng\nf 1 2 3\n")->groups, IsEmpty());
}

TEST(ObjTest, PointAndLineElementsGiveAGroupItsPoints) {
  const auto mesh = read(square + "g probes\np 4 2\nl 2/1 3/1\np -1\n");
  EXPECT_THAT(mesh->find_group("probes")->points, ElementsAre(1, 2, 3));
  EXPECT_THAT(mesh->find_group("probes")->faces, IsEmpty());
}

TEST(ObjTest, NamesBecomeUtf8) {
  const auto mesh = read(square +
                         "g stra\xdf"
                         "e\x01\nf 1 2 3\ng gr\xc3\xbcn\nf 1 3 4\n");
  EXPECT_THAT(names(*mesh), ElementsAre("stra\xc3\x9f"
                                        "e_",
                                        "gr\xc3\xbcn"));
}

TEST(ObjTest, ControlCharactersDoNotEndANameOrTheReading) {
  using namespace std::string_literals;
  const auto mesh = read(square + "g a\0b c\0\nf 1 2 3\n"s);
  EXPECT_THAT(names(*mesh), ElementsAre("a_b", "c_"));
}

TEST(ObjTest, LineContinuationsLineEndsAndComments) {
  const auto mesh =
      read("v 0 \\\n  0 0\r\nv 1 0 0 # here\r\nv 0 1 0#there\nf 1 \\\r\n 2 \\\n 3\n# f 1 2 \\\nf 3 2 1\nvp 1 \\\n f 9 9 9\n");
  EXPECT_EQ(mesh->point_count(), 3U);
  EXPECT_THAT(mesh->face_points, ElementsAre(0, 1, 2, 2, 1, 0));
  EXPECT_THAT(read("v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3\r")->face_points, ElementsAre(0, 1, 2));
}

TEST(ObjTest, AByteOrderMarkHidesNothing) { EXPECT_EQ(read("\xef\xbb\xbfv 0 0 0\nv 1 0 0\n")->point_count(), 2U); }

TEST(ObjTest, UglyFacesAreKept) { EXPECT_THAT(read(square + "f 1 2\nf 3\nf 1 1 2\n")->face_sizes, ElementsAre(2, 1, 3)); }

TEST(ObjTest, NumbersInEveryNotation) {
  const auto mesh = read("v +1 -.5 2.\nv 1e2 1E-2 -1.5e+3\nv 1e-400 -0 4.9e-324\n");
  EXPECT_EQ(mesh->points[0], (Vec3{1, -0.5, 2}));
  EXPECT_EQ(mesh->points[1], (Vec3{100, 0.01, -1500}));
  EXPECT_EQ(mesh->points[2], (Vec3{0, 0, 4.9e-324}));
  EXPECT_TRUE(std::signbit(mesh->points[2][1]));
}

const std::string rich =
    "# comment 1 2 3\r\nmtllib  a.mtl\r\no  body\r\n\tv  0.10  +0 \\\r\n -0.0 1.0\r\nv 1.000 0 0 0.5 0.25 1\r\nv 0 1e0 0 # v 1 2 "
    "3\r\n"
    "vt 0.10 0\r\nvn 0 0 1.0\r\ng a  b\r\ns off\r\nf 1/1/1  2/1/1\t3/1/1\r\n\r\nl 1 2\r\ncurv 0 1 1 2";

TEST(ObjTest, UndeformedPointsGiveTheSameBytes) {
  const auto file = parse_mesh(rich, "rich.obj");
  EXPECT_EQ(file->with_points(file->mesh()->points), rich);
}

TEST(ObjTest, OnlyChangedCoordinatesChange) {
  const auto file = parse_mesh(rich, "rich.obj");
  Points points = file->mesh()->points;
  points[0][2] = 0.1;
  points[1][0] = 1e22;
  points[2][1] = -1.0 / 3;
  std::string expected = rich;
  const auto replace = [&](const std::string& from, const std::string& to) {
    expected.replace(expected.find(from), from.size(), to);
  };
  replace(" -0.0 1.0", " 0.1 1.0");
  replace("v 1.000", "v 1e+22");
  replace("1e0", "-0.3333333333333333");
  EXPECT_EQ(file->with_points(points), expected);
  EXPECT_EQ(parse_mesh(expected, "again.obj")->mesh()->points, points);
}

TEST(ObjTest, TheSignOfZeroIsACoordinateToo) {
  const auto file = parse_mesh("v 0 -0.0 1\n", "zero.obj");
  EXPECT_EQ(file->with_points(Points{{-0.0, 0.0, 1}}), "v -0 0 1\n");
}

TEST(ObjTest, EveryDoubleSurvives) {
  const auto file = parse_mesh("v 1 2 3\n", "one.obj");
  for (const double value :
       {0.1, 1.0 / 3, 5e-324, 1.7976931348623157e39, -2.2250738585072014e-308, 123456789012345680.0, 4097.000000000001}) {
    const Points points{{value, -value, value / 7}};
    EXPECT_EQ(parse_mesh(file->with_points(points), "one.obj")->mesh()->points, points);
  }
}

// ---- normals that turn ----

std::unique_ptr<MeshFile> read_turning(const std::string& text) {
  ReadOptions options;
  options.turn_normals = true;
  return parse_mesh(text, "test.obj", options);
}

/// The numbers of all lines that begin with "vn ".
std::vector<Vec3> normals_in(const std::string& text) {
  std::vector<Vec3> normals;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    Vec3 n;
    if (std::sscanf(line.c_str(), "vn %lf %lf %lf", n.data(), n.data() + 1, n.data() + 2) == 3) normals.push_back(n);
  }
  return normals;
}

void expect_near(const Vec3& a, const Vec3& b) {
  for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(a[k], b[k], 1e-14);
}

// A roof of two squares with an edge between them: (0, 0) to (1, 1) flat, beyond x = 1 falling by 45 degrees.
const std::string roof =
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 -1\nv 2 1 -1\n"
    "vn 0 0 1.000\nvn 0.6 0 0.8\nvn nan 0 0\nvn 1 0\nvn 0 0 0\n";

TEST(ObjTest, NormalsStayWithoutTheOption) {
  const std::string text = roof + "f 1//1 2//1 3//1 4//1\n";
  const auto file = parse_mesh(text, "test.obj");
  Points points = file->mesh()->points;
  points[2][2] = points[3][2] = 1;
  EXPECT_EQ(normals_in(file->with_points(points))[0], (Vec3{0, 0, 1}));
}

TEST(ObjTest, NormalsTurnWithTheirFaces) {
  const std::string text = roof + "f 1//1 2//2 3//2 4//1\nf 2//2 5//2 6//2 3//2\nf 1/3/3 2//4 3//5\n";
  const auto file = read_turning(text);
  EXPECT_EQ(file->with_points(file->mesh()->points), text);
  // A rotation turns every normal by itself, whether or not it is that of its faces.
  const double c = std::cos(0.7), s = std::sin(0.7);
  const auto rotated = [&](const Vec3& x) { return Vec3{c * x[0] - s * x[2], x[1], s * x[0] + c * x[2]}; };
  Points points = file->mesh()->points;
  for (Vec3& x : points) x = rotated(x);
  const std::string written = file->with_points(points);
  const auto normals = normals_in(written);
  ASSERT_GE(normals.size(), 2U);
  expect_near(normals[0], rotated({0, 0, 1}));
  expect_near(normals[1], rotated({0.6, 0, 0.8}));
  EXPECT_NE(written.find("vn nan 0 0\nvn 1 0\nvn 0 0 0\n"), std::string::npos) << "what is no normal stays";
}

TEST(ObjTest, NormalsOfFacesAtRestKeepTheirSpelling) {
  // Relative and later normals; only the second square moves, and the normal of the first one keeps its spelling.
  const std::string text =
      "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\nvn 0 0 1.000\nf 1//-1 2//-1 3//-1 4//-1\n"
      "f 2//2 5//2 6//2 3//2\nvn 0.0 0 2e0\nf 1//9 2//-9 3//0 4//\n";
  const auto file = read_turning(text);
  Points points = file->mesh()->points;
  points[4] = {1, 0, 1};
  points[5] = {1, 1, 1};  // stands upright now, facing -x
  const std::string written = file->with_points(points);
  EXPECT_NE(written.find("vn 0 0 1.000\n"), std::string::npos);
  const auto normals = normals_in(written);
  ASSERT_EQ(normals.size(), 2U);
  expect_near(normals[1], {-2, 0, 0});
}

TEST(ObjTest, NormalsAreWeightedByArea) {
  // One normal for a flat triangle and one of three times its area, which is folded up by a right angle.
  const auto file = read_turning("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 -3 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf 1//1 4//1 2//1\n");
  Points points = file->mesh()->points;
  points[3] = {1, 0, 3};
  const auto normals = normals_in(file->with_points(points));
  ASSERT_EQ(normals.size(), 1U);
  const double length = std::sqrt(10.0);
  expect_near(normals[0], {0, 3 / length, 1 / length});
}

TEST(ObjTest, NormalsOfFacesThatLoseTheirAreaStay) {
  const auto file = read_turning("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n");
  EXPECT_EQ(normals_in(file->with_points(Points{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}))[0], (Vec3{0, 0, 1}));
  // Turned right over.
  expect_near(normals_in(file->with_points(Points{{0, 0, 0}, {1, 0, 0}, {0, -1, 0}}))[0], {0, 0, -1});
}

}  // namespace
}  // namespace deform::io::obj_test
