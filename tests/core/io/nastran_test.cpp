// SPDX-License-Identifier: GPL-3.0-or-later
// Nastran: the three field formats, what a changed coordinate does to its field, and what is refused.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include "core/io/mesh_file.h"
#include "core/quality/element_quality.h"
#include "tests/support/expect_error.h"

namespace deform::io::nastran_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

// A cube of small fields, a pyramid of large and a prism of free fields on it.
const std::string text = R"(SOL 101
SET 1 = 1, 2, 3
CEND
BEGIN BULK
$       ....2.......3.......4.......5
GRID           1              0.      0.      0.       0
GRID    2               1.0     0.
GRID    3       0       1.      1.      0.
grid           4              0.     1.0    -0.0
GRID    5                       0.      1.0
GRID           6             1.0            1.  $ y is blank
GRID*                  7                              1.              1.
*                     1.
GRID*   8                               0.0             1.0             *A
*A      1.0
$ a comment
GRID,9,,5.-1,5.D-1,2.E0,0
GRID,10,0,2.,0.
GRID , 11 , , 2. ,0.,1.0
CORD2R  1       0       0.      0.      0.      0.      0.      1.      +B
+B      1.      0.      0.
CHEXA   1       10      1       2       3       4       5       6       +E1
+E1     7       8
CPYRAM* 2                             11               5               6
*                      7               8               9
CPENTA,3,10,2,10,3,6,11,7,+
+
CBAR    7       1       1       2       0.      0.      1.
CQUAD4  20      1       1       4       3       2
CQUAD4        21       2       5       6       7       8     .01
CTRIA3,22,,10,11,6
ENDDATA
GRID    99
)";

const Group& group(const Mesh& mesh, const std::string& name) {
  const Group* found = mesh.find_group(name);
  if (found == nullptr) throw Error(ErrorCode::not_found, "no group " + name);
  return *found;
}

TEST(Nastran, GroupsAndElements) {
  const auto file = parse_mesh(text, "a.bdf");
  EXPECT_EQ(file->format(), Format::nastran);
  const auto mesh = file->mesh();
  ASSERT_EQ(mesh->point_count(), 11u);
  EXPECT_EQ(mesh->points[1], (Vec3{1, 0, 0}));
  EXPECT_EQ(mesh->points[4], (Vec3{0, 0, 1}));
  EXPECT_EQ(mesh->points[5], (Vec3{1, 0, 1}));
  EXPECT_EQ(mesh->points[6], (Vec3{1, 1, 1}));
  EXPECT_EQ(mesh->points[7], (Vec3{0, 1, 1}));
  EXPECT_EQ(mesh->points[8], (Vec3{0.5, 0.5, 2}));
  EXPECT_EQ(mesh->points[10], (Vec3{2, 0, 1}));
  EXPECT_THAT(file->elements()->types, ElementsAre(ElementType::hexahedron, ElementType::pyramid, ElementType::prism));
  EXPECT_EQ(element_quality(mesh->points, *file->elements()).inverted_elements, 0u);
  EXPECT_EQ(mesh->face_count(), 4u + 4 + 4);
  EXPECT_THAT(group(*mesh, "pid_1").faces, SizeIs(1));
  EXPECT_THAT(group(*mesh, "pid_2").points, ElementsAre(4, 5, 6, 7)) << "between cube and pyramid";
  EXPECT_THAT(group(*mesh, "pid_10").points, SizeIs(10));
  EXPECT_THAT(group(*mesh, "pid_11").points, ElementsAre(4, 5, 6, 7, 8));
  EXPECT_THAT(group(*mesh, "pid_22").points, ElementsAre(5, 9, 10)) << "no face of the boundary; its property is its number";
  for (const char* name : {"a.nas", "a.DAT"}) EXPECT_EQ(parse_mesh(text, name)->mesh()->points, mesh->points) << name;
}

/// What the line that begins with `before` becomes when the coordinates of `point` change; nothing else may.
void expect_line(std::size_t point, const Vec3& moved, const std::string& before, const std::string& after) {
  const auto file = parse_mesh(text, "a.bdf");
  Points points = file->mesh()->points;
  points[point] = moved;
  std::string expected = text;
  ASSERT_NE(expected.find(before), std::string::npos);
  expected.replace(expected.find(before), before.size(), after);
  const std::string written = file->with_points(points);
  EXPECT_EQ(written, expected);
  const Vec3 back = parse_mesh(written, "a.bdf")->mesh()->points[point];
  for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(back[k], moved[k], 1e-4 * std::abs(moved[k]));
}

TEST(Nastran, ChangedCoordinatesFitIntoTheirFields) {
  EXPECT_EQ(parse_mesh(text, "a.bdf")->with_points(parse_mesh(text, "a.bdf")->mesh()->points), text);
  expect_line(0, {1.0 / 3, 0, -2e-5 / 3}, "GRID           1              0.      0.      0.       0\n",
              "GRID           1        .3333333      0.-6.667-6       0\n");
  expect_line(1, {1.25, 0, 0}, "GRID    2               1.0     0.\n", "GRID    2               1.25    0.\n");
  expect_line(1, {1, 0.5, 0}, "1.0     0.\n", "1.0     .5\n");
  expect_line(1, {1, 0, 0.5}, "1.0     0.\n", "1.0     0.            .5\n");
  expect_line(1, {1, 10000.5, 0.5}, "1.0     0.\n", "1.0     10000.5       .5\n");
  expect_line(3, {0, 1, 0}, "    1.0    -0.0\n", "    1.0      0.\n");
  expect_line(5, {1, -1, 1}, "    1.0            1.  $ y", "    1.0     -1.    1.  $ y");
  expect_line(6, {1, 1.0 / 3, 1}, "7                              1.              1.\n",
              "7                              1..333333333333333\n");
  expect_line(7, {0, 1, 2.0 / 3}, "*A      1.0\n", "*A      .666666666666667\n");
  expect_line(8, {0.25, 0.5, 1.0 / 3}, "5.-1,5.D-1,2.E0,0", ".25,5.D-1,.3333333,0");
  expect_line(9, {2, 0, 7}, "GRID,10,0,2.,0.\n", "GRID,10,0,2.,0.,7.\n");
  expect_line(10, {2, 0.5, 1}, "2. ,0.,1.0\n", "2. ,.5,1.0\n");
}

TEST(Nastran, FieldsThatLack) {
  const auto written = [](const std::string& grid, const Vec3& point) {
    const auto file = parse_mesh(grid, "a.bdf");
    const std::string bytes = file->with_points(Points{point});
    EXPECT_EQ(parse_mesh(bytes, "a.bdf")->mesh()->points[0], point);
    return bytes;
  };
  EXPECT_EQ(written("GRID    1", {0, 2, 0}), "GRID    1                             2.");
  EXPECT_EQ(written("GRID    1\n", {1, 0, 3}), "GRID    1                     1.              3.\n");
  EXPECT_EQ(written("GRID    1\r\n", {1, 2, 3}), "GRID    1                     1.      2.      3.\r\n");
  EXPECT_EQ(written("GRID,1\n", {1, 0, 3}), "GRID,1,,1.,,3.\n");
  EXPECT_EQ(written("GRID,1,,  $ c\n", {0, 2, 0}), "GRID,1,,,2.  $ c\n");
  EXPECT_EQ(written("GRID,1,,1.,+A\n+A,0\n", {1, 0, 0}), "GRID,1,,1.,+A\n+A,0\n");
  EXPECT_EQ(written("GRID,1,,1.,+A\n+A,0\n", {1, 0, 5}), "GRID,1,,1.,,5.,+A\n+A,0\n");
  EXPECT_EQ(written("GRID*   1\n", {0, 0, 3}), "GRID*   1\n*                     3.\n");
  EXPECT_EQ(written("GRID*   1\r\n*\r\n", {1, 0, 3}),
            "GRID*   1                                             1.\r\n*                     3.\r\n");
  EXPECT_EQ(written("GRID*,1,,1.,2.\n", {1, 2, 3}), "GRID*,1,,1.,2.\n*,3.\n");
  EXPECT_EQ(written("GRID*,1,,1.,2.,*\n*,3.\n", {1, 2, 0.1}), "GRID*,1,,1.,2.,*\n*,.1\n");
  EXPECT_EQ(written("GRID,1,,0.12345678901,0.,0.\n", {0.98765432101, 0, 0}), "GRID,1,,.98765432101,0.,0.\n")
      << "a file with longer numbers is read by who takes them";
}

TEST(Nastran, LineEndsAndTheLinesBetween) {
  std::string crlf;
  for (const char c : text) crlf += c == '\n' ? std::string("\r\n") : std::string(1, c);
  std::string cr = text;
  std::replace(cr.begin(), cr.end(), '\n', '\r');
  for (const std::string& bytes : {crlf, cr, "\xef\xbb\xbf" + text}) {
    const auto file = parse_mesh(bytes, "a.bdf");
    EXPECT_EQ(file->mesh()->points, parse_mesh(text, "a.bdf")->mesh()->points);
    EXPECT_EQ(file->mesh()->face_count(), 12u);
    EXPECT_EQ(file->with_points(file->mesh()->points), bytes);
  }
}

/// One element of every quadratic type: nodes amid edges as the Quick Reference Guide draws them.
TEST(Nastran, QuadraticElements) {
  const std::vector<Vec3> cube = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
  const std::vector<Vec3> prism = {cube[0], cube[1], cube[3], cube[4], cube[5], cube[7]};
  struct Tested {
    const char* card;
    ElementType expected;
    std::vector<Vec3> corners;
    std::vector<std::array<int, 2>> between;  // corners from 1
  };
  const Tested table[] = {
      {"CTETRA",
       ElementType::tetrahedron10,
       {cube[0], cube[1], cube[3], cube[4]},
       {{1, 2}, {2, 3}, {1, 3}, {1, 4}, {2, 4}, {3, 4}}},
      {"CPYRAM",
       ElementType::pyramid13,
       {cube[0], cube[1], cube[2], cube[3], {0.5, 0.5, 1}},
       {{1, 2}, {2, 3}, {3, 4}, {4, 1}, {1, 5}, {2, 5}, {3, 5}, {4, 5}}},
      {"CPENTA", ElementType::prism15, prism, {{1, 2}, {2, 3}, {3, 1}, {1, 4}, {2, 5}, {3, 6}, {4, 5}, {5, 6}, {6, 4}}},
      {"CHEXA",
       ElementType::hexahedron20,
       cube,
       {{1, 2}, {2, 3}, {3, 4}, {4, 1}, {1, 5}, {2, 6}, {3, 7}, {4, 8}, {5, 6}, {6, 7}, {7, 8}, {8, 5}}},
  };
  for (const Tested& tested : table) {
    SCOPED_TRACE(tested.card);
    std::vector<Vec3> points = tested.corners;
    for (const auto& edge : tested.between) {
      Vec3 middle;
      for (std::size_t k = 0; k < 3; ++k) middle[k] = (points[edge[0] - 1][k] + points[edge[1] - 1][k]) / 2;
      points.push_back(middle);
    }
    std::string bytes, card = std::string(tested.card) + ",1,1";
    std::size_t fields = 2;
    for (std::size_t i = 0; i < points.size(); ++i) {
      bytes += "GRID," + std::to_string(i + 1) + ",";
      for (const double c : points[i]) bytes.append(",").append(testing::PrintToString(c));
      bytes += "\n";
      if (fields++ % 8 == 0) card += ",\n";
      card.append(",").append(std::to_string(i + 1));
    }
    const auto file = parse_mesh(bytes + card + "\n", "a.bdf");
    ASSERT_THAT(file->elements()->types, ElementsAre(tested.expected));
    const ElementShape& form = shape(tested.expected);
    const auto nodes = file->elements()->nodes(0);
    for (std::size_t e = 0; e < form.edges.size(); ++e) {
      const Vec3 &a = points[nodes[form.edges[e][0]]], &b = points[nodes[form.edges[e][1]]];
      EXPECT_EQ(points[nodes[form.corners + e]], (Vec3{(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2})) << "edge " << e;
    }
    EXPECT_EQ(element_quality(points, *file->elements()).inverted_elements, 0u);
  }
}

TEST(Nastran, QuadraticSurfaces) {
  std::string bytes;
  for (int i = 1; i <= 9; ++i) bytes += "GRID," + std::to_string(i) + ",," + std::to_string(i) + ".\n";
  const auto mesh =
      parse_mesh(bytes + "CTRIA6,1,5,1,2,3,4,5,6\nCQUAD8,2,5,1,2,3,4,5,6,+\n+,7,8,.1\nCTRIA6,3,5,1,2,3\n", "a.bdf")->mesh();
  EXPECT_THAT(mesh->face_sizes, ElementsAre(6, 8, 3));
  EXPECT_THAT(std::vector<PointId>(mesh->face_points.begin(), mesh->face_points.begin() + 6), ElementsAre(0, 3, 1, 4, 2, 5));
  EXPECT_THAT(group(*mesh, "pid_5").faces, ElementsAre(0, 1, 2));
}

// What is not on the first line is blank, and the thicknesses stay behind both mid-side nodes of the second.
TEST(Nastran, LinesThatEndEarlyGoOnWhereTheirFieldsEnd) {
  std::string bytes;
  for (int i = 1; i <= 4; ++i) bytes += "GRID," + std::to_string(i) + ",," + std::to_string(i) + ".\n";
  for (const char* card : {"CQUAD8,2,5,1,2,3,4,+\n+,,,.1,.1,.1,.1\n", "CQUAD8,2,5,1,2,3,4,,,+A\n+A,,,.1,.1,.1,.1\n"}) {
    const auto mesh = parse_mesh(bytes + card, "a.bdf")->mesh();
    EXPECT_THAT(mesh->face_sizes, ElementsAre(4)) << card;
    EXPECT_THAT(mesh->face_points, ElementsAre(0, 1, 2, 3)) << card;
  }
}

TEST(Nastran, RefusesWhatIsWrong) {
  const std::string grids = "GRID,1\nGRID,2\nGRID,3\nGRID,4\n";
  const std::pair<std::string, std::vector<const char*>> table[] = {
      {"", {"line 1", "no GRID"}},
      {"BEGIN BULK\nENDDATA\nGRID,1\n", {"no GRID"}},
      {"GRID\n", {"line 1", "GRID", "number of a grid point", "field 2"}},
      {"GRID,1.5\n", {"integer", "\"1.5\""}},
      {"GRID,1\nGRID    1\n", {"line 2", "grid point 1 is there already"}},
      {"GRID,1,,1.0,abc,0.\n", {"line 1", "a coordinate", "field 5", "\"abc\""}},
      {"GRID,1,,nan,0.,0.\n", {"finite number", "\"nan\""}},
      {"GRID,1,,1.+999\n", {"finite number"}},
      {"GRID,1\nGRID,2,7\n", {"line 2", "grid point 2", "coordinate system 7"}},
      {"GRID,1,0\nGRID,2\nGRDSET,,3\n", {"line 2", "GRDSET", "system 3"}},
      {"GRID\t1\n", {"line 1", "tab"}},
      {"INCLUDE 'nodes.bdf'\n", {"line 1", "INCLUDE"}},
      {"GRID,1\n=,*(1),=\n", {"line 2", "replication"}},
      {"BEGIN BULK\nGRID,1\nBEGIN SUPER=2\n", {"line 3", "superelements"}},
      {grids + "CTETRA,1,1,1,2,3,5\n", {"line 5", "CTETRA 1", "grid point 5"}},
      {grids + "CTETRA,1,1,1,2,3\n", {"line 5", "CTETRA", "grid point", "field 7"}},
      {grids + "CTETRA,1,1,1,2,3,4,1\n", {"line 5", "CTETRA 1", "1 of its 6"}},
      {grids + "CTRIA3,1,x,1,2,3\n", {"a property", "\"x\""}},
      {grids + "CTRIA3,1,1,1,2,3,,,,9\n", {"line 5", "more than 8 fields", "\"9\""}},
      {"GRID*,1,,1.,2.,3.\n", {"line 1", "more than 4 fields"}},
      {grids + "CTRIA3  1       1       1       2       3                               +A\n+B\n",
       {"line 6", "\"+B\"", "\"+A\""}},
      {grids + "CTETRA,1,1,1,2,3,4\nCTETRA,2,1,1,2,3,4\nCTETRA,3,1,1,2,3,4\n", {"belongs to 3 elements"}},
  };
  for (const auto& [bytes, message] : table) {
    SCOPED_TRACE(bytes);
    std::vector<const char*> parts = message;
    parts.push_back("a.bdf: ");
    test::expect_error(ErrorCode::invalid_argument, parts, [&, &input = bytes] { parse_mesh(input, "a.bdf"); });
  }
  const auto file = parse_mesh("GRID    1\n", "a.bdf");
  test::expect_error(ErrorCode::invalid_argument, {"points[0]: coordinate y", "8 characters"}, [&] {
    file->with_points(Points{{0, -1.79e308, 0}});
  });
}

}  // namespace
}  // namespace deform::io::nastran_test
