// SPDX-License-Identifier: GPL-3.0-or-later
// The byte sequence behind an id, written out by hand once.
#include "core/codec/geometry_id.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <set>

namespace deform::codec::geometry_id_test {
namespace {

std::string sha256(const std::string& bytes) {
  Sha256 hash;
  hash.add(bytes.data(), bytes.size());
  return hash.hex();
}

template <typename T>
std::string raw(T value) {
  std::string bytes(sizeof(T), '\0');
  std::memcpy(bytes.data(), &value, sizeof(T));
  return bytes;
}

struct Arrays {
  Points points{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  std::vector<std::uint32_t> sizes{3};
  std::vector<PointId> corners{0, 1, 2};
  std::vector<PointId> group_points{2};
  std::vector<FaceId> group_faces{0};
  std::string name = "nose";
  std::string id() const {
    const GroupView groups[] = {{name, group_points, group_faces}};
    return geometry_id({points, sizes, corners, groups});
  }
};

TEST(Sha256, known_answers) {
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(GeometryId, is_the_hash_of_the_documented_bytes) {
  std::string bytes("deform.geometry.1", 18);
  bytes += raw<std::uint64_t>(3);
  for (const double x : {0., 0., 0., 1., 0., 0., 0., 1., 0.}) bytes += raw(x);
  bytes += raw<std::uint64_t>(1) + raw<std::uint32_t>(3);
  bytes += raw<std::uint64_t>(3) + raw<std::uint32_t>(0) + raw<std::uint32_t>(1) + raw<std::uint32_t>(2);
  bytes += raw<std::uint64_t>(1) + raw<std::uint64_t>(4) + "nose";
  bytes += raw<std::uint64_t>(1) + raw<std::uint32_t>(2) + raw<std::uint64_t>(1) + raw<std::uint32_t>(0);
  EXPECT_EQ(Arrays().id(), sha256(bytes));
}

TEST(GeometryId, everything_matters) {
  std::set<std::string> ids{Arrays().id()};
  const auto expect_new = [&](const Arrays& arrays, const char* what) { EXPECT_TRUE(ids.insert(arrays.id()).second) << what; };
  Arrays a;
  a.points[2][1] = std::nextafter(1.0, 2.0);
  expect_new(a, "last bit of a coordinate");
  a = {};
  a.points[0][0] = -0.0;
  expect_new(a, "negative zero");
  a = {};
  a.corners = {0, 2, 1};
  expect_new(a, "orientation");
  a = {};
  a.sizes = {1, 2};
  expect_new(a, "face sizes");
  a = {};
  a.name = "roof";
  expect_new(a, "group name");
  a = {};
  a.group_points = {};
  a.group_faces = {2, 0};
  expect_new(a, "points or faces of a group");
  std::swap(a.group_points, a.group_faces);
  expect_new(a, "the other way round");
}

/// The same arrays with cells of both kinds, each array of another size and content. No mesh has both; the bytes are defined all
/// the same.
struct CellArrays : Arrays {
  std::vector<std::uint8_t> types{4, 6};
  std::vector<PointId> nodes{0, 1, 2, 2, 1};
  std::uint64_t cell_count = 3;
  std::vector<std::uint64_t> offsets{0, 3, 6, 8};
  std::vector<PointId> cell_face_points{2, 1, 0, 1, 2, 0};
  std::vector<std::uint32_t> owner{1, 0, 2, 5, 4, 3, 6};
  std::vector<std::uint32_t> neighbour{7};
  std::vector<char> empty_faces{0, 1, 1};
  std::string id() const {
    const GroupView groups[] = {{name, group_points, group_faces}};
    return geometry_id(
        {points, sizes, corners, groups, {types, nodes, cell_count, offsets, cell_face_points, owner, neighbour, empty_faces}});
  }
};

template <typename T>
std::string raw_array(const std::vector<T>& values) {
  std::string bytes = raw<std::uint64_t>(values.size());
  for (const T value : values) bytes += raw(value);
  return bytes;
}

TEST(GeometryId, cells_follow_in_the_documented_order) {
  const CellArrays a;
  std::string bytes("deform.geometry.2", 18);
  bytes += raw<std::uint64_t>(3);
  for (const double x : {0., 0., 0., 1., 0., 0., 0., 1., 0.}) bytes += raw(x);
  bytes += raw_array(a.sizes) + raw_array(a.corners);
  bytes += raw<std::uint64_t>(1) + raw<std::uint64_t>(4) + "nose" + raw_array(a.group_points) + raw_array(a.group_faces);
  bytes += raw_array(a.types) + raw_array(a.nodes) + raw(a.cell_count) + raw_array(a.offsets) + raw_array(a.cell_face_points);
  bytes += raw_array(a.owner) + raw_array(a.neighbour) + raw_array(a.empty_faces);
  EXPECT_EQ(a.id(), sha256(bytes));
}

}  // namespace
}  // namespace deform::codec::geometry_id_test
