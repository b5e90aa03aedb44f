// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <bit>

#include "core/io/binary/byte_order.h"
#include "core/io/mesh_file.h"

namespace deform::io::ply_test {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

std::string header(const std::string& format, const std::string& rest) {
  return "ply\nformat " + format + " 1.0\ncomment made by hand\n" + rest + "end_header\n";
}

const std::string plain =
    "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_indices\n";

const std::string rich =
    "element camera 1\nproperty double view\nproperty list ushort short marks\n"
    "element vertex 3\nproperty uchar red\nproperty double z\nproperty list uint8 float32 weights\nproperty double x\n"
    "property int id\nproperty double y\n"
    "element nothing 1000000000000\n"
    "element face 2\nproperty float area\nproperty list uint uint vertex_index\nproperty list uchar float texcoord\n"
    "element edge 1\nproperty int vertex1\nproperty int vertex2\n";

/// Appends values of any type in one byte order.
class Bytes {
 public:
  Bytes(std::string text, std::endian order) : text_(std::move(text)), order_(order) {}
  template <typename T>
  Bytes& put(std::initializer_list<double> values) {
    for (const double value : values) {
      if constexpr (std::is_same_v<T, float>) {
        store(std::bit_cast<std::uint32_t>(static_cast<float>(value)));
      } else if constexpr (std::is_same_v<T, double>) {
        store(std::bit_cast<std::uint64_t>(value));
      } else {
        store(static_cast<std::make_unsigned_t<T>>(static_cast<T>(value)));
      }
    }
    return *this;
  }
  const std::string& text() const { return text_; }

 private:
  template <typename U>
  void store(U value) {
    text_.resize(text_.size() + sizeof(U));
    store_scalar(text_.data() + text_.size() - sizeof(U), value, order_);
  }
  std::string text_;
  std::endian order_;
};

const char* name_of(std::endian order) { return order == std::endian::big ? "binary_big_endian" : "binary_little_endian"; }

TEST(PlyTest, Ascii) {
  const std::string text = header("ascii", plain) + "0 0 0 \n1 0 0\n0 1 0.5\n3 0 1 2\n2 2 0\n";
  const auto file = parse_mesh(text, "test.ply");
  EXPECT_THAT(file->mesh()->points, ElementsAre(Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{0, 1, 0.5}));
  EXPECT_THAT(file->mesh()->face_sizes, ElementsAre(3, 2));
  EXPECT_THAT(file->mesh()->face_points, ElementsAre(0, 1, 2, 2, 0));
  EXPECT_EQ(file->with_points(file->mesh()->points), text);
}

TEST(PlyTest, AsciiWithEverythingElseKeptInPlace) {
  const std::string text = header("ascii", rich) +
                           "1.5 2 -1 -2\n7 0.00 0 1.0 -5 2\n8 0 2 0.5 0.5 3 -5 4\n9 1e0 1 0.25 5 -5 6\n"
                           "0.5 3 0 1 2 2 0.5 0.5\n0.5 3 2 1 0 0\n0 1\n";
  const auto file = parse_mesh(text, "test.ply");
  EXPECT_THAT(file->mesh()->points, ElementsAre(Vec3{1, 2, 0}, Vec3{3, 4, 0}, Vec3{5, 6, 1}));
  EXPECT_THAT(file->mesh()->face_points, ElementsAre(0, 1, 2, 2, 1, 0));
  EXPECT_EQ(file->with_points(file->mesh()->points), text);
  std::string expected = text;
  expected.replace(expected.find("7 0.00 0 1.0 -5 2"), 17, "7 0.125 0 11 -5 2");
  expected.replace(expected.find("1e0"), 3, "-1");
  EXPECT_EQ(file->with_points(Points{{11, 2, 0.125}, {3, 4, 0}, {5, 6, -1}}), expected);
}

TEST(PlyTest, BinaryOfBothByteOrders) {
  for (const std::endian order : {std::endian::big, std::endian::little}) {
    Bytes bytes(header(name_of(order), plain), order);
    bytes.put<float>({0, 0, 0, 1, 0, 0, 0, 1, 0.5}).put<std::uint8_t>({3}).put<std::int32_t>({0, 1, 2});
    bytes.put<std::uint8_t>({2}).put<std::int32_t>({2, 0});
    const auto file = parse_mesh(bytes.text(), "test.ply");
    EXPECT_THAT(file->mesh()->points, ElementsAre(Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{0, 1, 0.5}));
    EXPECT_THAT(file->mesh()->face_points, ElementsAre(0, 1, 2, 2, 0));
    EXPECT_EQ(file->with_points(file->mesh()->points), bytes.text());

    const std::string written = file->with_points(Points{{0, 0, 0}, {0.1, 0, 0}, {0, 1, -2}});
    EXPECT_EQ(written.substr(0, written.size() - 22 - 24), bytes.text().substr(0, bytes.text().size() - 22 - 24));
    EXPECT_EQ(written.substr(written.size() - 22), bytes.text().substr(bytes.text().size() - 22));
    EXPECT_THAT(parse_mesh(written, "test.ply")->mesh()->points, ElementsAre(Vec3{0, 0, 0}, Vec3{0.1F, 0, 0}, Vec3{0, 1, -2}));
  }
}

TEST(PlyTest, BinaryWithEverythingElseKeptInPlace) {
  for (const std::endian order : {std::endian::big, std::endian::little}) {
    const auto make = [&](const Points& p) {
      Bytes bytes(header(name_of(order), rich), order);
      bytes.put<double>({1.5}).put<std::uint16_t>({2}).put<std::int16_t>({-1, -2});
      for (std::size_t i = 0; i < 3; ++i) {
        bytes.put<std::uint8_t>({7}).put<double>({p[i][2]}).put<std::uint8_t>({double(i)});
        for (std::size_t w = 0; w < i; ++w) bytes.put<float>({0.5});
        bytes.put<double>({p[i][0]}).put<std::int32_t>({-5}).put<double>({p[i][1]});
      }
      bytes.put<float>({0.5}).put<std::uint32_t>({3, 0, 1, 2}).put<std::uint8_t>({2}).put<float>({0.5, 0.5});
      bytes.put<float>({0.5}).put<std::uint32_t>({3, 2, 1, 0}).put<std::uint8_t>({0});
      bytes.put<std::int32_t>({0, 1});
      return bytes.text();
    };
    const Points points{{1, 2, 0}, {3, 4, 0}, {5, 6, 1}}, moved{{1, 0.1, 0}, {1.0 / 3, 4, 1e-300}, {5, 6, -1}};
    const auto file = parse_mesh(make(points), "test.ply");
    EXPECT_EQ(file->mesh()->points, points);
    EXPECT_THAT(file->mesh()->face_points, ElementsAre(0, 1, 2, 2, 1, 0));
    EXPECT_EQ(file->with_points(points), make(points));
    EXPECT_EQ(file->with_points(moved), make(moved));
  }
}

TEST(PlyTest, EveryIntegerTypeOfIndices) {
  const auto expect_quad = [](const char* count, const char* index, auto put) {
    Bytes bytes(header("binary_little_endian",
                       "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list " +
                           std::string(count) + " " + index + " vertex_indices\n"),
                std::endian::little);
    bytes.put<float>({0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0});
    put(bytes);
    EXPECT_THAT(parse_mesh(bytes.text(), "test.ply")->mesh()->face_points, ElementsAre(0, 1, 2, 3)) << count << " " << index;
  };
  expect_quad("char", "uchar", [](Bytes& b) { b.put<std::int8_t>({4}).put<std::uint8_t>({0, 1, 2, 3}); });
  expect_quad("int8", "int8", [](Bytes& b) { b.put<std::int8_t>({4}).put<std::int8_t>({0, 1, 2, 3}); });
  expect_quad("short", "ushort", [](Bytes& b) { b.put<std::int16_t>({4}).put<std::uint16_t>({0, 1, 2, 3}); });
  expect_quad("uint16", "int16", [](Bytes& b) { b.put<std::uint16_t>({4}).put<std::int16_t>({0, 1, 2, 3}); });
  expect_quad("uint32", "int32", [](Bytes& b) { b.put<std::uint32_t>({4}).put<std::int32_t>({0, 1, 2, 3}); });
  expect_quad("int", "uint", [](Bytes& b) { b.put<std::int32_t>({4}).put<std::uint32_t>({0, 1, 2, 3}); });
}

TEST(PlyTest, TriangleStripsTurnEveryOtherTriangle) {
  const std::string text = header("ascii",
                                  "element vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
                                  "element tristrips 1\nproperty list int int vertex_indices\n") +
                           "0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 2 0\n9 0 1 2 3 -1 2 2 3 4\n";
  const auto mesh = parse_mesh(text, "test.ply")->mesh();
  EXPECT_THAT(mesh->face_sizes, ElementsAre(3, 3, 3));
  EXPECT_THAT(mesh->face_points, ElementsAre(0, 1, 2, 2, 1, 3, 3, 2, 4));
}

TEST(PlyTest, PointCloudsAndCarriageReturnsInTheHeader) {
  const std::string text =
      "ply\r\nformat ascii 1.0\r\nobj_info x\r\nelement vertex 1\r\nproperty float x\r\nproperty float y\r\nproperty float "
      "z\r\nend_header\r\n1 2 3\r\n";
  const auto file = parse_mesh(text, "test.ply");
  EXPECT_THAT(file->mesh()->points, ElementsAre(Vec3{1, 2, 3}));
  EXPECT_THAT(file->mesh()->face_sizes, IsEmpty());
  EXPECT_EQ(file->with_points(Points{{1, 2, 4}}), text.substr(0, text.size() - 3) + "4\r\n");
}

TEST(PlyTest, FacesBeforeVertices) {
  const std::string text = header("ascii",
                                  "element face 1\nproperty list uchar int vertex_indices\nelement vertex 3\nproperty float "
                                  "x\nproperty float y\nproperty float z\n") +
                           "3 0 1 2\n0 0 0\n1 0 0\n0 1 0\n";
  EXPECT_THAT(parse_mesh(text, "test.ply")->mesh()->face_points, ElementsAre(0, 1, 2));
}

}  // namespace
}  // namespace deform::io::ply_test
