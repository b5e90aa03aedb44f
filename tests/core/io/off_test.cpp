// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <bit>

#include "core/io/binary/byte_order.h"
#include "core/io/mesh_file.h"

namespace deform::io::off_test {
namespace {

using testing::ElementsAre;

std::shared_ptr<const Mesh> read(const std::string& text) {
  auto mesh = parse_mesh(text, "test.off")->mesh();
  mesh->validate();
  return mesh;
}

void expect_triangle_and_quad(const std::string& text) {
  SCOPED_TRACE(text);
  const auto file = parse_mesh(text, "test.off");
  const auto mesh = file->mesh();
  EXPECT_THAT(mesh->points, ElementsAre(Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{1, 1, 0.5}, Vec3{0, 1, 0}));
  EXPECT_THAT(mesh->face_sizes, ElementsAre(3, 4));
  EXPECT_THAT(mesh->face_points, ElementsAre(0, 1, 2, 3, 2, 1, 0));
  EXPECT_EQ(file->with_points(mesh->points), text);
  const Points moved{{9, 9, 9}, {1.5, 0, 0}, {1, 1, 0.5}, {-0.25, 8, 7}};
  EXPECT_EQ(parse_mesh(file->with_points(moved), "test.off")->mesh()->points, moved);
}

TEST(OffTest, EveryHeaderAndLayoutOfTheSameMesh) {
  expect_triangle_and_quad("OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 .5\n0 1 0\n3 0 1 2\n4 3 2 1 0\n");
  expect_triangle_and_quad("OFF 4 2 0\n0 0 0\n1 0 0\n1 1 .5\n0 1 0\n3 0 1 2\n4 3 2 1 0");
  expect_triangle_and_quad("# first\n\n  OFF4 2 # counts\n0 0 0\n1 0 0 # one\n\n#\n1 1 .5\n0 1 0\n3 0 1 2\n4 3 2 1 0\n# last");
  expect_triangle_and_quad("OFF\r\n4 2 0\r\n0 0 0\r\n1 0 0\r\n1 1 .5\r\n0 1 0\r\n3 0 1 2\r\n4 3 2 1 0\r\n");
  expect_triangle_and_quad("COFF\n4 2 0\n0 0 0 1 1 1 1\n1 0 0 255 0 0 255\n1 1 .5 1 1 1\n0 1 0 7\n3 0 1 2\n4 3 2 1 0\n");
  expect_triangle_and_quad("NOFF\n4 2 0\n0 0 0 0 0 1\n1 0 0 0 0 1\n1 1 .5 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n4 3 2 1 0\n");
  expect_triangle_and_quad("STOFF\n4 2 0\n0 0 0 0 1\n1 0 0 0 1\n1 1 .5 0 1\n0 1 0 0 1\n3 0 1 2\n4 3 2 1 0\n");
  expect_triangle_and_quad("OFF\n4 2 0\n0 0 0 255 0 0\n1 0 0\n1 1 .5 0.5\n0 1 0\n3 0 1 2 1.0 0.5 0.5 1\n4 3 2 1 0 7\n");
}

TEST(OffTest, LinesMeanNothing) {
  expect_triangle_and_quad("OFF 4 2 0 0 0 0 1 0 0 1 1 .5 0 1 0 3 0 1 2\n4 3 2 1 0\n");
  expect_triangle_and_quad("OFF\n4\n2 0\n0 0\n0 1\n0 0\n1 1 .5 0 1 0\n3 0\n1 2\n4 3 2\n1 0\n");
  expect_triangle_and_quad(
      "CNOFF 4 2 0 0 0 0 0 0 1 1 1 1 1 1 0 0 0 0 1 1 1 1 1 1 1 .5 0 0 1 1 1 1 1 0 1 0 0 0 1 1 1 1 1\n3 0 1 2\n4 3 2 1 0\n");
}

TEST(OffTest, PointsWithoutFaces) { EXPECT_EQ(read("OFF\n2 0 0\n0 0 0\n1 1 1\n")->point_count(), 2U); }

TEST(OffTest, OnlyCoordinatesChange) {
  const std::string text = "COFF # x\n2 1 0\n 1.50  2 3.0\t10 20 30 40\n4 5 6 1 1 1 1 # last\n2 0 1 # face 1.50\n";
  const auto file = parse_mesh(text, "test.off");
  EXPECT_EQ(file->with_points(Points{{1.5, 2.25, 3}, {4, 5, -6}}),
            "COFF # x\n2 1 0\n 1.50  2.25 3.0\t10 20 30 40\n4 5 -6 1 1 1 1 # last\n2 0 1 # face 1.50\n");
}

std::string binary_off(const std::string& header, std::endian order, bool face_colours, std::size_t extras) {
  std::string bytes = header + "\n";
  const auto put = [&](std::uint32_t value) {
    bytes.resize(bytes.size() + 4);
    store_scalar(bytes.data() + bytes.size() - 4, value, order);
  };
  for (const std::uint32_t count : {3, 2, 0}) put(count);
  for (const float x : {0.F, 1.F, 2.F}) {
    for (const float c : {x, 0.5F, -x}) put(std::bit_cast<std::uint32_t>(c));
    for (std::size_t i = 0; i < extras; ++i) put(std::bit_cast<std::uint32_t>(9.F));
  }
  for (const std::uint32_t value : {3, 0, 1, 2}) put(value);
  if (face_colours) {
    for (const std::uint32_t value : {3, 7, 7, 7}) put(value);
  }
  for (const std::uint32_t value : {2, 2, 1}) put(value);
  if (face_colours) put(0);
  return bytes;
}

TEST(OffTest, BinaryOfBothByteOrdersWithAndWithoutFaceColours) {
  for (const std::endian order : {std::endian::big, std::endian::little}) {
    for (const bool colours : {true, false}) {
      for (const auto& [header, extras] : {std::pair{"OFF BINARY", 0}, {"NOFF BINARY", 3}, {"STNCOFF  BINARY ", 9}}) {
        const std::string bytes = binary_off(header, order, colours, extras);
        const auto file = parse_mesh(bytes, "test.off");
        EXPECT_THAT(file->mesh()->points, ElementsAre(Vec3{0, 0.5, -0.0}, Vec3{1, 0.5, -1}, Vec3{2, 0.5, -2}));
        EXPECT_THAT(file->mesh()->face_points, ElementsAre(0, 1, 2, 2, 1));
        EXPECT_EQ(file->with_points(file->mesh()->points), bytes);

        const Points moved{{0, 0.5, 4}, {0.1, 0.5, -1}, {2, 0.5, 1.0 / 3}};
        const std::string written = file->with_points(moved);
        ASSERT_EQ(written.size(), bytes.size());
        EXPECT_THAT(parse_mesh(written, "test.off")->mesh()->points,
                    ElementsAre(Vec3{0, 0.5, 4}, Vec3{0.1F, 0.5, -1}, Vec3{2, 0.5, 1.F / 3}));
        std::size_t changed = 0;
        for (std::size_t i = 0; i < bytes.size(); ++i) changed += bytes[i] != written[i];
        EXPECT_LE(changed, 12U);
      }
    }
  }
}

}  // namespace
}  // namespace deform::io::off_test
