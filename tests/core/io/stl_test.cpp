// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdio>

#include "core/io/binary/byte_order.h"
#include "core/io/mesh_file.h"

namespace deform::io::stl_test {
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
    std::string record(50, '\xff');  // a normal that is no number and attribute bytes, which must survive
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

/// Two facets with the given normals over the same corners.
std::string with_normals(const std::string& first, const std::string& second, const std::string& corner) {
  return "solid s\n facet normal " + first + " outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet\n" +
         " facet normal " + second + " outer loop vertex 1 0 0 vertex " + corner + " vertex 0 1 0 endloop endfacet\nendsolid\n";
}

TEST(StlTest, NormalsOfMovedFacetsAreThoseOfTheNewCorners) {
  const std::string text = with_normals("0 0 1.000", "0.0 0 1e0", "1 1 0");
  const auto file = parse_mesh(text, "test.stl");
  Points points = file->mesh()->points;
  EXPECT_EQ(file->with_points(points), text) << "at rest the same bytes";
  points[3] = {1, 0, 1};  // the second facet stands upright
  const double share = std::sqrt(0.5);
  const auto written = file->with_points(points);
  const auto read = parse_mesh(written, "test.stl");
  EXPECT_EQ(read->mesh()->points, points);
  EXPECT_NE(written.find("normal 0 0 1.000 outer"), std::string::npos) << "the first facet has not moved";
  double normal[3];
  ASSERT_EQ(std::sscanf(written.c_str() + written.rfind("normal"), "normal %lf %lf %lf", normal, normal + 1, normal + 2), 3);
  EXPECT_NEAR(normal[0], -share, 1e-15);
  EXPECT_NEAR(normal[1], -share, 1e-15);
  EXPECT_NEAR(normal[2], 0, 1e-15);
  // A normal that pointed to the other side goes on doing so; zero, broken and missing ones stay.
  const auto inward = parse_mesh(with_normals("0 0 -1", "0 0 -2", "1 1 0"), "test.stl")->with_points(points);
  ASSERT_EQ(std::sscanf(inward.c_str() + inward.rfind("normal"), "normal %lf", normal), 1);
  EXPECT_NEAR(normal[0], share, 1e-15);
  for (const char* kept : {"0 0 0", "-0 0 0.0", "nan 0 1", "", "1 2", "x y z"}) {
    const auto unchanged = parse_mesh(with_normals("0 0 1", kept, "1 1 0"), "test.stl")->with_points(points);
    EXPECT_EQ(unchanged, with_normals("0 0 1", kept, "1 0 1")) << kept;
  }
  // Collapsed to a line: no normal.
  points[3] = points[1];
  const auto collapsed = parse_mesh(text, "test.stl")->with_points(points);
  EXPECT_NE(collapsed.find("normal 0.0 0 0 outer"), std::string::npos) << collapsed;
}

TEST(StlTest, NormalsInBinary) {
  const auto store = [](std::string& bytes, std::size_t triangle, const std::array<float, 3>& normal) {
    for (std::size_t k = 0; k < 3; ++k) {
      store_scalar(bytes.data() + 84 + 50 * triangle + 4 * k, std::bit_cast<std::uint32_t>(normal[k]), std::endian::little);
    }
  };
  const auto of = [&](const std::array<float, 9>& second) {
    return binary("any", {{0, 0, 0, 1, 0, 0, 0, 1, 0}, second, {5, 0, 0, 6, 0, 0, 5, 1, 0}});
  };
  std::string bytes = of({1, 0, 0, 1, 1, 0, 0, 1, 0}), expected = of({1, 0, 0, 1, 0, 1, 0, 1, 0});
  for (std::string* one : {&bytes, &expected}) {
    store(*one, 0, {0, 0, 1});
    store(*one, 1, {0, 0, 1});
    store(*one, 2, {0, 0, 0});
  }
  const auto file = parse_mesh(bytes, "test.stl");
  Points points = file->mesh()->points;
  EXPECT_EQ(file->with_points(points), bytes);
  points[3] = {1, 0, 1};
  const auto share = static_cast<float>(std::sqrt(0.5));
  const std::string written = file->with_points(points);
  store(expected, 1, {-share, -share, 0});
  // The last bit of the float may go either way.
  const auto z = [&](std::size_t k) {
    return std::bit_cast<float>(load_scalar<std::uint32_t>(written.data() + 84 + 50 + 4 * k, std::endian::little));
  };
  EXPECT_NEAR(z(0), -share, 1e-7);
  EXPECT_NEAR(z(1), -share, 1e-7);
  EXPECT_EQ(std::abs(z(2)), 0);
  store(expected, 1, {z(0), z(1), z(2)});
  EXPECT_EQ(written, expected) << "nothing else changes: the facet at rest, the zero normal, attributes";
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
}  // namespace deform::io::stl_test
