// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>

#include "core/io/binary/byte_order.h"
#include "core/io/mesh_file.h"

namespace deform::io {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

std::string facet(const std::string& a, const std::string& b, const std::string& c) {
  return " facet normal 0.5 nan 0\n  outer loop\n   vertex " + a + "\n   vertex " + b + "\n   vertex " + c +
         "\n  endloop\n endfacet\n";
}

const std::string two_facets = facet("0 0 0", "1 0 0", "0 1.0 0") + facet("1.00 0 -0.0", "1 1 0", "0 1 0");

std::string binary(const std::string& start, std::initializer_list<std::array<float, 9>> triangles) {
  std::string bytes = start;
  bytes.resize(84, ' ');
  store_scalar(bytes.data() + 80, static_cast<std::uint32_t>(triangles.size()), std::endian::little);
  for (const auto& triangle : triangles) {
    std::string record(50, '\x7f');  // normal and attribute bytes that must survive
    for (std::size_t i = 0; i < 9; ++i)
      store_scalar(record.data() + 12 + 4 * i, std::bit_cast<std::uint32_t>(triangle[i]), std::endian::little);
    bytes += record;
  }
  return bytes;
}

TEST(StlTest, CoincidentCornersAreOnePoint) {
  const auto mesh = parse_mesh("solid a\n" + two_facets + "endsolid a\n", "test.stl")->mesh();
  EXPECT_THAT(mesh->points, ElementsAre(Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{1, 1, 0}));
  EXPECT_THAT(mesh->face_sizes, ElementsAre(3, 3));
  EXPECT_THAT(mesh->face_points, ElementsAre(0, 1, 2, 1, 3, 2));
}

TEST(StlTest, NearlyCoincidentCornersAreNot) {
  EXPECT_EQ(parse_mesh(
                "solid a\n" + facet("0 0 0", "1 0 0", "0 1 0") + facet("1.0000000000000002 0 0", "1 1 0", "0 1 0") + "endsolid\n",
                "t.stl")
                ->mesh()
                ->point_count(),
            5U);
}

TEST(StlTest, APointIsWrittenToEveryCorner) {
  const std::string text = "solid a\n" + two_facets + "endsolid a\n";
  const auto file = parse_mesh(text, "test.stl");
  EXPECT_EQ(file->with_points(file->mesh()->points), text);  // 1, 1.00 and -0.0 as they were
  const Points moved{{0, 0, 0}, {1, 0.25, 0}, {0, 1, 0}, {1, 1, 1e-7}};
  EXPECT_EQ(file->with_points(moved),
            "solid a\n" + facet("0 0 0", "1 0.25 0", "0 1.0 0") + facet("1.00 0.25 -0.0", "1 1 1e-07", "0 1 0") + "endsolid a\n");
}

TEST(StlTest, SolidsAreGroupsAndShareTheirPoints) {
  const auto mesh =
      parse_mesh("solid left side\n" + facet("0 0 0", "1 0 0", "0 1 0") + "endsolid left side\nsolid\n" +
                     facet("1 0 0", "1 1 0", "0 1 0") + "endsolid\nsolid nothing\nendsolid nothing\nsolid left side\n" +
                     facet("5 5 5", "6 5 5", "5 6 5") + "endsolid",
                 "test.stl")
          ->mesh();
  ASSERT_EQ(mesh->groups.size(), 2U);
  EXPECT_EQ(mesh->groups[0].name, "left side");
  EXPECT_THAT(mesh->groups[0].faces, ElementsAre(0, 2));
  EXPECT_EQ(mesh->groups[1].name, "solid_2");
  EXPECT_THAT(mesh->groups[1].faces, ElementsAre(1));
  EXPECT_EQ(mesh->point_count(), 7U);
}

TEST(StlTest, KeywordsInAnyCaseAndSpacing) {
  const auto mesh = parse_mesh(
                        "\r\n SOLID\r\nFACET NORMAL 0 0 1 OUTER LOOP VERTEX 0 0 0 VERTEX 1 0 0\r\nVertex 0 1 0 ENDLOOP ENDFACET "
                        "ENDSOLID x y\r\n",
                        "test.stl")
                        ->mesh();
  EXPECT_THAT(mesh->face_points, ElementsAre(0, 1, 2));
}

TEST(StlTest, Binary) {
  const std::string bytes = binary("any header", {{0, 0, 0, 1, 0, 0, 0, 1, 0}, {1, 0, -0.F, 1, 1, 0, 0, 1, 0}});
  const auto file = parse_mesh(bytes, "test.stl");
  EXPECT_THAT(file->mesh()->points, ElementsAre(Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{1, 1, 0}));
  EXPECT_THAT(file->mesh()->face_points, ElementsAre(0, 1, 2, 1, 3, 2));
  EXPECT_THAT(file->mesh()->groups, IsEmpty());
  EXPECT_EQ(file->with_points(file->mesh()->points), bytes);
  EXPECT_EQ(file->with_points(Points{{0, 0, 0}, {1, 0.1, 0}, {0, 1, 0}, {1, 1, 7}}),
            binary("any header", {{0, 0, 0, 1, 0.1F, 0, 0, 1, 0}, {1, 0.1F, -0.F, 1, 1, 7, 0, 1, 0}}));
}

TEST(StlTest, ABinaryHeaderMayBeginWithSolid) {
  const std::string bytes = binary("solid exported by a program", {{0, 0, 0, 1, 0, 0, 0, 1, 0}});
  const auto file = parse_mesh(bytes, "test.stl");
  EXPECT_THAT(file->mesh()->face_points, ElementsAre(0, 1, 2));
  EXPECT_EQ(file->with_points(file->mesh()->points), bytes);
}

TEST(StlTest, ManyPointsWeldInOrderOfAppearance) {
  // A fan of 5000 triangles round the origin: the table of points grows several times.
  std::string text = "solid fan\n";
  const int n = 5000;
  for (int i = 0; i < n; ++i) {
    text += facet("0 0 0", std::to_string(i) + " 1 0", std::to_string(i + 1) + " 1 0");
  }
  const auto mesh = parse_mesh(text + "endsolid fan\n", "fan.stl")->mesh();
  ASSERT_EQ(mesh->point_count(), n + 2U);
  for (int i = 0; i < n; ++i) {
    ASSERT_EQ(mesh->face_points[3 * i], 0U);
    ASSERT_EQ(mesh->face_points[3 * i + 2], i + 2U);
  }
}

}  // namespace
}  // namespace deform::io
