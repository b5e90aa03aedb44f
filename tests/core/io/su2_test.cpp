// SPDX-License-Identifier: GPL-3.0-or-later
// SU2: a cube under a prism in three dimensions, two triangles and a quad in two.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "core/io/mesh_file.h"
#include "core/quality/element_quality.h"
#include "tests/core/io/text_diff.h"
#include "tests/support/expect_error.h"

namespace deform::io::su2_test {
namespace {

using testing::ElementsAre;

/// Tabs for tildes.
std::string with_tabs(std::string text) {
  std::replace(text.begin(), text.end(), '~', '\t');
  return text;
}

const std::string plane = with_tabs(R"(% a comment
NDIME=2
NELEM= 3
9 0 1 2 3 0
5  1 4 2  1
5~4 5 2~2   % tabs
NPOIN= 6 6
0.0 0.0 0
1.0~0~1
  1 1.0 2
0 1 3 77
+2.0 .5 4
2 1.5 5
NMARK= 2
MARKER_TAG= lower wall
MARKER_ELEMS= 2
3 0 1
3 1 4 0
FFD_NBOX= 1
FFD_CORNER_POINTS= 1
0.1 0.2
MARKER_TAG= SEND_RECEIVE
MARKER_ELEMS= 1
SEND_RECV= 1
1 5 0
)");

// Points behind the elements, the prism in VTK's order (base seen from outside).
const std::string solid = R"(NELEM= 2
12 0 1 2 3 4 5 6 7
13 4 5 8 7 6 9
NDIME = 3
NMARK= 2
MARKER_TAG= bottom
MARKER_ELEMS= 1
9 0 3 2 1
MARKER_TAG= between
MARKER_ELEMS= 2
9 4 5 6 7
3 4 8
NPOIN= 10
0 0 0
1 0 0
1 1 0
0 1 0
0 0 1
1 0 1
1 1 1
0 1 1
0.5 0 2
0.5 1 2
)";

std::string spoilt(std::string bytes, const std::string& from, const std::string& to) {
  return bytes.replace(bytes.find(from), from.size(), to);
}

TEST(Su2, FacesAndMarkersOfAPlaneMesh) {
  const auto file = parse_mesh(plane, "a.su2");
  EXPECT_EQ(file->format(), Format::su2);
  const auto mesh = file->mesh();
  EXPECT_EQ(file->elements(), nullptr);
  EXPECT_THAT(mesh->face_sizes, ElementsAre(4, 3, 3));
  EXPECT_THAT(mesh->face_points, ElementsAre(0, 1, 2, 3, 1, 4, 2, 4, 5, 2));
  EXPECT_EQ(mesh->points[4], (Vec3{2, 0.5, 0}));
  ASSERT_EQ(mesh->groups.size(), 2u);
  EXPECT_EQ(mesh->groups[0].name, "lower");
  EXPECT_THAT(mesh->groups[0].points, ElementsAre(0, 1, 4));
  EXPECT_THAT(mesh->groups[0].faces, ElementsAre());
  EXPECT_THAT(mesh->groups[1].points, ElementsAre(5));
}

TEST(Su2, APlaneMeshStaysInItsPlane) {
  const auto file = parse_mesh(plane, "a.su2");
  EXPECT_EQ(file->with_points(file->mesh()->points), plane);
  EXPECT_TRUE(file->two_dimensional());
  Points moved = file->mesh()->points;
  moved[1] = {1.25, 0, 1e-13};  // rounding of a rotation
  moved[4][1] = -0.5;
  EXPECT_EQ(file->with_points(moved), spoilt(spoilt(plane, "1.0\t0\t1", "1.25\t0\t1"), "+2.0 .5 4", "+2.0 -0.5 4"));
  moved[3][2] = 1e-11;
  test::expect_error(ErrorCode::invalid_argument, {"points[3]", "z moves by 1e-11", "two-dimensional"},
                     [&] { file->with_points(moved); });
}

TEST(Su2, ElementsAndMarkersOfASolid) {
  const auto file = parse_mesh(solid, "a.su2");
  EXPECT_FALSE(file->two_dimensional());
  const auto mesh = file->mesh();
  const auto elements = file->elements();
  ASSERT_NE(elements, nullptr);
  EXPECT_THAT(elements->nodes(1), ElementsAre(4, 8, 5, 7, 9, 6)) << "the base seen from inside";
  const auto quality = element_quality(mesh->points, *elements);
  EXPECT_EQ(quality.inverted_elements, 0u);
  EXPECT_DOUBLE_EQ(quality.total_volume, 1.5);
  EXPECT_EQ(mesh->face_count(), 5u + 4);
  EXPECT_THAT(mesh->find_group("bottom")->faces, testing::SizeIs(1));
  EXPECT_THAT(mesh->find_group("between")->points, ElementsAre(4, 5, 6, 7));
  EXPECT_THAT(mesh->find_group("pointZone:between")->points, ElementsAre(4, 8));
  Points moved = mesh->points;
  for (Vec3& p : moved) p = {p[0] + 0.5, p[1] * 3 + 0.125, p[2] - 7};
  const std::string written = file->with_points(moved);
  EXPECT_EQ(test::changed_words(solid, written).size(), 30u);
  EXPECT_EQ(parse_mesh(written, "a.su2")->mesh()->points, moved);
}

TEST(Su2, WedgesOfTheOtherOrderAreRecognised) {
  const auto file = parse_mesh(spoilt(solid, "13 4 5 8 7 6 9", "13 4 8 5 7 9 6"), "a.su2");
  EXPECT_THAT(file->elements()->nodes(1), ElementsAre(4, 8, 5, 7, 9, 6));
}

TEST(Su2, RefusesWhatIsWrong) {
  const std::pair<std::string, std::vector<const char*>> table[] = {
      {"", {"no NDIME="}},
      {"NDIME= 2\n", {"no NPOIN="}},
      {"NDIME=\nNPOIN= 1\n0 0\n", {"line 1", "number behind NDIME="}},
      {spoilt(plane, "NDIME=2", "NDIME=4"), {"line 2", "NDIME= 4"}},
      {plane + "NDIME= 2\n", {"line 26", "second NDIME="}},
      {plane + "NZONE= 2\n", {"NZONE= 2", "one zone"}},
      {plane + "NPOIN= 1\n0 0\n", {"second NPOIN="}},
      {plane + "NELEM= 1\n5 0 1 2\n", {"second NELEM="}},
      {spoilt(plane, "NPOIN= 6 6", "NPOIN= 0"), {"NPOIN= 0"}},
      {spoilt(plane, "NPOIN= 6 6", "NPOIN= -6"), {"line 7", "NPOIN= -6"}},
      {spoilt(plane, "NPOIN= 6 6", "NPOIN= 99999999999"), {"line 7", "99999999999", "bytes left"}},
      {spoilt(plane, "NPOIN= 6 6", "NPOIN= 7"), {"line 14", "coordinate", "NMARK="}},
      {spoilt(solid, "NPOIN= 10", "NPOIN= 9"), {"out of range 0..8"}},
      {plane + "MARKER_TAG= a\nMARKER_ELEMS= 1\n3 0 1\n3 1 4\n", {"line 29", "keyword behind the 1 lines of MARKER_ELEMS="}},
      {spoilt(plane, "1.0\t0\t1", "1.0"), {"line 9", "2 coordinates"}},
      {spoilt(plane, "1.0\t0\t1", "1.0\tnan\t1"), {"line 9", "nan", "finite"}},
      {spoilt(plane, "9 0 1 2 3 0", "12 0 1 2 3 0 1 2 3"), {"line 4", "NELEM[0]", "type 12 is a volume", "NDIME= 2"}},
      {spoilt(plane, "9 0 1 2 3 0", "10 0 1 2 3 0"), {"line 4", "NELEM[0]", "type 10 is a volume", "NDIME= 2"}},
      {spoilt(plane, "9 0 1 2 3 0", "14 0 1 2 3 4 0"), {"line 4", "NELEM[0]", "type 14 is a volume", "NDIME= 2"}},
      {spoilt(plane, "9 0 1 2 3 0", "7 0 1 2 3 0"), {"line 4", "NELEM[0]", "type 7"}},
      {spoilt(plane, "9 0 1 2 3 0", "9 0 1 2"), {"line 4", "NELEM[0]", "4 points"}},
      {spoilt(plane, "9 0 1 2 3 0", "9 0 1 2 6 0"), {"line 4", "NELEM[0]", "point 6", "0..5"}},
      {spoilt(plane, "9 0 1 2 3 0", "9 0 1 2 -1 0"), {"line 4", "point -1", "0..5"}},
      {spoilt(plane, "NELEM= 3", "NELEM= 4"), {"line 7", "integer", "NPOIN="}},
      {spoilt(plane, "NELEM= 3", "NELEM= 4000000"), {"4000000", "bytes left"}},
      {spoilt(plane, "MARKER_TAG= lower wall", "MARKER_TAG="), {"line 15", "without a name"}},
      {spoilt(plane, "MARKER_TAG= lower wall\n", ""), {"line 15", "without a MARKER_TAG="}},
      {spoilt(plane, "3 0 1\n", "5 0 1 2\n"), {"line 17", "MARKER_ELEMS[0]", "a surface"}},
      {spoilt(solid, "9 4 5 6 7\n", "10 4 5 6 7\n"), {"MARKER_ELEMS[0]", "a volume cannot bound"}},
      {plane.substr(0, plane.size() - 6), {"the file ends in MARKER_ELEMS= 1", "behind 0 lines"}},
      {spoilt(solid, "13 4 5 8 7 6 9", "12 0 1 2 3 4 5 6 7\n12 0 1 2 3 4 5 6 7"), {"keyword behind the 2 lines"}},
      {spoilt(solid, "NELEM= 2", "NELEM= 4\n12 0 1 2 3 4 5 6 7\n12 0 1 2 3 4 5 6 7"), {"elements[", "belongs to 3 elements"}},
  };
  for (const auto& [bytes, message] : table) {
    SCOPED_TRACE(bytes.substr(0, 80));
    test::expect_error(ErrorCode::invalid_argument, message, [&, &input = bytes] { parse_mesh(input, "a.su2"); });
  }
}

}  // namespace
}  // namespace deform::io::su2_test
