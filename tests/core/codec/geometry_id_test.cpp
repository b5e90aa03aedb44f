// SPDX-License-Identifier: GPL-3.0-or-later
// The byte sequence behind an id, written out by hand once.
#include "core/codec/geometry_id.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <set>

namespace deform::codec {
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

}  // namespace
}  // namespace deform::codec
