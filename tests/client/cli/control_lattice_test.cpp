// SPDX-License-Identifier: GPL-3.0-or-later
// Lattices of setup files: where their control points are, and files of them.
#include "client/cli/setup/control_lattice.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <unistd.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "client/cli/output/lattice_file.h"
#include "client/cli/setup/reading.h"
#include "core/io/mesh_file.h"
#include "tests/support/expect_error.h"

namespace deform::cli::control_lattice_test {
namespace {

using test::expect_error;

v1::Setup setup(const std::string& text) {
  v1::Setup setup;
  parse_yaml(text, "setup.yaml", setup);
  return setup;
}

/// Control points of a clamped lattice of 4 x 4 x 4 over [0, 3] x [0, 6] x [0, 9] are at 0, 1/3, 2/3 and 1 of it.
const char* const clamped =
    "method: {ffd: {control: CONTROLS, lattice: {basis: CLAMPED_CUBIC, points: [4, 4, 4], box: {min: [0, 0, 0], max: [3, 6, "
    "9]}}}}\n"
    "handles: [{name: a, region: {lattice: {i: [3, 3], j: [0, 0]}}}, {name: b, region: {control: {ids: [0]}}}]\n"
    "variables: [{name: up, handle: a, translate: [0, 0, 2], upper: 0.5}, {name: turn, handle: a, rotate: {axis: [0, 0, 1]}},\n"
    "            {name: grow, handle: b, scale: {centre: [1, 1, 1]}}]\n";

std::vector<Vec3> grid() {
  std::vector<Vec3> places;
  for (int k = 0; k < 4; ++k) {
    for (int j = 0; j < 4; ++j) {
      for (int i = 0; i < 4; ++i) places.push_back({double(i), 2.0 * j, 3.0 * k});
    }
  }
  return places;
}

void expect_near(const std::vector<Vec3>& got, const std::vector<Vec3>& expected) {
  ASSERT_EQ(got.size(), expected.size());
  for (std::size_t p = 0; p < got.size(); ++p) {
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(got[p][k], expected[p][k], 1e-14) << p;
  }
}

TEST(ControlLattice, MovesAsTheVariablesSay) {
  const v1::Setup moving = setup(clamped);
  const ControlLattice lattice = control_lattice(moving, Mesh());
  expect_near(lattice.places, grid());
  std::vector<Vec3> expected = grid();
  const double angle = 0.7;
  for (std::size_t k = 0; k < 4; ++k) {  // first up, then about the z axis
    expected[3 + 16 * k] = {3 * std::cos(angle), 3 * std::sin(angle), 3.0 * static_cast<double>(k) + 2 * 0.25};
  }
  expected[0] = {-0.5, -0.5, -0.5};
  expect_near(moved_controls(moving, lattice, {0.25, angle, 0.5}), expected);
  expect_error(ErrorCode::invalid_argument, {"variable \"up\"", "0.6", "0.5"}, [&] {
    moved_controls(moving, lattice, {0.6, 0, 0});
  });
}

TEST(ControlLattice, MovesAllHandlesOfAVariable) {
  v1::Setup moving = setup(clamped);
  moving.mutable_variables(0)->add_also()->set_handle("b");
  const ControlLattice lattice = control_lattice(moving, Mesh());
  std::vector<Vec3> expected = grid();
  for (std::size_t k = 0; k < 4; ++k) expected[3 + 16 * k][2] += 0.5;
  expected[0][2] += 0.5;
  expect_near(moved_controls(moving, lattice, {0.25, 0, 0}), expected);
  moving.mutable_variables(0)->mutable_also(0)->add_translate(-4);
  for (int k = 0; k < 2; ++k) moving.mutable_variables(0)->mutable_also(0)->add_translate(0);
  expected[0] = {-1, 0, 0};
  expect_near(moved_controls(moving, lattice, {0.25, 0, 0}), expected);
}

TEST(ControlLattice, IsRefusedWithItsField) {
  expect_error(ErrorCode::invalid_argument, {"method.ffd"}, [] { control_lattice(setup("seed: 1\n"), Mesh()); });
  expect_error(ErrorCode::invalid_argument, {"method.ffd.lattice", "3 points"}, [] {
    control_lattice(setup("method: {ffd: {lattice: {points: [3, 4, 4], box: {min: [0, 0, 0], max: [1, 1, 1]}}}}\n"), Mesh());
  });
}

/// Half of a box, its other half beyond y = 1.
Mesh half_box() {
  Mesh mesh;
  for (const double x : {0.0, 4.0}) {
    for (const double y : {1.0, 3.0}) {
      for (const double z : {0.0, 2.0}) mesh.points.push_back({x, y, z});
    }
  }
  return mesh;
}

TEST(ControlLattice, SurroundsTheImagesOfAHalfModel) {
  const std::string automatic = "method: {ffd: {control: CONTROLS, lattice: {points: [5, 7, 4]}}}\n";
  const double padding = 0.02 * 6;  // of the diagonal of 4 x 4 x 2
  for (const char* plane :
       {"symmetry: [{point: [7, 1, 0], normal: [0, -3, 0]}]\n", "symmetry: [{region: {ids: [0, 1, 4, 5]}}]\n"}) {
    const ControlLattice lattice = control_lattice(setup(automatic + plane), half_box());
    const LatticeFrame& frame = lattice.lattice.frame();
    EXPECT_NEAR(frame.origin[1], -1 - padding, 1e-14);
    EXPECT_NEAR(frame.axes[1][1], 4 + 2 * padding, 1e-14);
    EXPECT_NEAR(frame.origin[0], -padding, 1e-14);
    EXPECT_NEAR(frame.axes[0][0], 4 + 2 * padding, 1e-14);
  }
  expect_error(ErrorCode::invalid_argument, {"method.ffd.lattice", "symmetry[0]", "`box`"},
               [&] { control_lattice(setup(automatic + "symmetry: [{region: {ids: [0, 3, 4, 7]}}]\n"), half_box()); });
}

TEST(ControlLattice, MovesMirrorImagesOfControlPoints) {
  const v1::Setup moving = setup(std::string(clamped) + "symmetry: [{point: [0, 3, 0], normal: [0, 1, 0]}]\n");
  const ControlLattice lattice = control_lattice(moving, half_box());
  std::vector<Vec3> moved = moved_controls(moving, lattice, {0.25, 0.7, 0});
  const std::vector<Vec3> before = moved;
  move_images(client::mirror_planes(moving, half_box()), lattice.places, moved);
  for (std::size_t k = 0; k < 4; ++k) {
    const Vec3& own = before[3 + 16 * k];
    EXPECT_EQ(moved[3 + 16 * k], own);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(moved[15 + 16 * k][c], c == 1 ? 6 - own[c] : own[c], 1e-14);
    EXPECT_EQ(moved[7 + 16 * k], lattice.places[7 + 16 * k]);
  }
}

// Points in the plane move along it only.
TEST(ControlLattice, KeepsControlPointsInThePlane) {
  const v1::Setup half = setup(std::string(clamped) + "symmetry: [{point: [0, 3, 0], normal: [0, 1, 0]}]\n");
  const std::vector<Vec3> places{{1, 3, 0}, {1, 4, 0}};
  std::vector<Vec3> moved{{1.5, 3.25, 1}, {1.5, 4.25, 1}};
  move_images(client::mirror_planes(half, half_box()), places, moved);
  EXPECT_EQ(moved[0], (Vec3{1.5, 3, 1}));
  EXPECT_EQ(moved[1], (Vec3{1.5, 4.25, 1}));
}

class ControlFile : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("deform_lattice_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
    return folder_ / name;
  }

  std::filesystem::path folder_;
};

/// What `deform lattice` writes is what `control_points` takes.
TEST_F(ControlFile, OfALatticeIsRead) {
  const v1::Setup moving = setup(clamped);
  const ControlLattice lattice = control_lattice(moving, Mesh());
  LatticePicture picture{lattice, moved_controls(moving, lattice, {0.25, 0.7, 0.5}), std::vector<std::uint32_t>(64, 2), {"a"}};
  write_lattice(picture, folder_ / "moved.vtp");
  const auto mesh = io::read_mesh_file(folder_ / "moved.vtp")->mesh();
  EXPECT_EQ(mesh->points, picture.moved);
  const auto file = write("setup.yaml", "geometry: aaaaaaaa\nmethod: {ffd: {lattice: {control_points: {file: moved.vtp}}}}\n");
  const std::string bytes = read_setup_file(file).setup.method().ffd().lattice().control_points();
  ASSERT_EQ(bytes.size(), 64 * sizeof(Vec3));
  EXPECT_EQ(std::memcmp(bytes.data(), picture.moved.data(), bytes.size()), 0);
}

TEST_F(ControlFile, MayBeCsv) {
  const std::string bytes = read_control_points(write("c.csv", "z,x,y\n3,1,2\n6,4,5\n"));
  const std::vector<Vec3> expected{{1, 2, 3}, {4, 5, 6}};
  ASSERT_EQ(bytes.size(), 2 * sizeof(Vec3));
  EXPECT_EQ(std::memcmp(bytes.data(), expected.data(), bytes.size()), 0);
  write("bad.csv", "x,y\n1,2\n");
  const auto file = write("setup.yaml", "geometry: aaaaaaaa\n\nmethod: {ffd: {lattice: {control_points: {file: bad.csv}}}}\n");
  expect_error(ErrorCode::invalid_argument, {"setup.yaml:3", "control_points", "bad.csv", "column \"z\""},
               [&] { read_setup_file(file); });
}

// `deform show --setup` prints them so.
TEST(ControlLattice, BytesAreBase64) {
  const v1::Setup parsed = setup("method: {ffd: {lattice: {control_points: AAECAw==}}}\n");
  EXPECT_EQ(parsed.method().ffd().lattice().control_points(), std::string("\0\1\2\3", 4));
  for (const char* wrong : {"{ffd: {lattice: {control_points: lattice.vtp}}}", "{ffd: {lattice: {control_points: [1]}}}",
                            "{ffd: {lattice: {control_points: {file: c.vtp, set: a}}}}"}) {
    expect_error(ErrorCode::invalid_argument, {"setup.yaml:1", "control_points", "base64"},
                 [&] { setup(std::string("method: ") + wrong); });
  }
}

}  // namespace
}  // namespace deform::cli::control_lattice_test
