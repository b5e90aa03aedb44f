// SPDX-License-Identifier: GPL-3.0-or-later
// Coloured faces as PLY: our own reader finds the mesh in it.
#include "core/io/coloured_ply.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "core/io/mesh_file.h"
#include "tests/support/expect_error.h"

namespace deform::io::coloured_ply_test {
namespace {

Mesh two_faces() {
  Mesh mesh;
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0.1}, {0, 1, 1e-17}, {2, 0.5, -3}};
  mesh.face_sizes = {4, 3};
  mesh.face_points = {0, 1, 2, 3, 1, 4, 2};
  return mesh;
}

TEST(ColouredPly, IsReadBack) {
  const Mesh mesh = two_faces();
  const std::vector<Colour> colours{{1, 2, 3}, {255, 128, 0}};
  const auto path = std::filesystem::temp_directory_path() / ("deform_coloured_" + std::to_string(::getpid()) + ".ply");
  write_coloured_ply(mesh, colours, path);
  const auto file = read_mesh_file(path);
  std::filesystem::remove(path);
  EXPECT_EQ(file->mesh()->points, mesh.points);
  EXPECT_EQ(file->mesh()->face_sizes, mesh.face_sizes);
  EXPECT_EQ(file->mesh()->face_points, mesh.face_points);
  const std::string bytes = coloured_ply_bytes(mesh, colours);
  EXPECT_EQ(bytes.substr(bytes.size() - 3), std::string("\xff\x80\x00", 3));
}

TEST(ColouredPly, PointsAreColouredToo) {
  const Mesh mesh = two_faces();
  std::vector<Colour> colours(5, Colour{7, 8, 9});
  colours[4] = {255, 128, 0};
  const std::string bytes = point_coloured_ply_bytes(mesh, colours);
  const auto file = parse_mesh(bytes, "a.ply");
  EXPECT_EQ(file->mesh()->points, mesh.points);
  EXPECT_EQ(file->mesh()->face_points, mesh.face_points);
  const std::size_t begin = bytes.find("end_header\n") + 11;
  EXPECT_EQ(bytes.substr(begin + 24, 3), "\x07\x08\x09");
  EXPECT_EQ(bytes.substr(begin + 4 * 27 + 24, 3), std::string("\xff\x80\x00", 3));
  test::expect_error(ErrorCode::invalid_argument, {"colours", "2 for 5 points"},
                     [&] { point_coloured_ply_bytes(mesh, std::vector<Colour>(2)); });
}

TEST(ColouredPly, Refusals) {
  Mesh mesh = two_faces();
  test::expect_error(ErrorCode::invalid_argument, {"colours", "1 for 2"},
                     [&] { coloured_ply_bytes(mesh, std::vector<Colour>(1)); });
  mesh.face_sizes = {256};
  mesh.face_points.assign(256, 0);
  test::expect_error(ErrorCode::invalid_argument, {"face 0", "256 corners"},
                     [&] { coloured_ply_bytes(mesh, std::vector<Colour>(1)); });
}

}  // namespace
}  // namespace deform::io::coloured_ply_test
