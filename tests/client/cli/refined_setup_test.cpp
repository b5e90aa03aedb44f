// SPDX-License-Identifier: GPL-3.0-or-later
// Setups whose lattices are refined: what they say afterwards, and that points stay where they are.
#include "client/cli/setup/refined_setup.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

#include "client/cli/setup/reading.h"
#include "core/base/vectors.h"
#include "core/numerics/lattice/moved_lattice.h"
#include "tests/support/expect_error.h"

namespace deform::cli::refined_setup_test {
namespace {

using test::expect_error;
using testing::HasSubstr;

class RefinedLattice : public testing::Test {
 protected:
  RefinedLattice() {
    std::filesystem::create_directories(folder_);
    write("box.obj", "v 0 0 0\n");
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> uniform(0, 1);
    for (int i = 0; i < 300; ++i) mesh_.points.push_back({3 * uniform(random), 6 * uniform(random), 9 * uniform(random)});
  }
  ~RefinedLattice() override { std::filesystem::remove_all(folder_); }

  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }

  RefinedSetup refine(const std::string& text, const std::array<bool, 3>& axes, const std::vector<double>& values = {}) const {
    write("setup.yaml", text);
    return refined_setup({folder_ / "setup.yaml", axes, values, "points.csv", "moved.obj"}, mesh_);
  }

  /// The new setup, with its control points.
  v1::Setup read(const RefinedSetup& refined) const {
    std::string csv = "x,y,z\n";
    for (const Vec3& x : refined.lattice.places) {
      char line[120];
      std::snprintf(line, sizeof line, "%.17g,%.17g,%.17g\n", x[0], x[1], x[2]);
      csv += line;
    }
    write("points.csv", csv);
    write("moved.obj", "v 0 0 0\n");
    write("refined.yaml", refined.text);
    return read_setup_file(folder_ / "refined.yaml").setup;
  }

  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / ("refined_setup_test_" + std::to_string(::getpid()));
  Mesh mesh_;
};

std::string setup_text(const std::string& lattice, const std::string& rest) {
  return "# a comment\ngeometry: box.obj\nmethod: {ffd: {control: CONTROLS, lattice: {" + lattice + "}}}\n" + rest;
}

const std::string box = "box: {min: [-0.5, -0.5, -0.5], max: [3.5, 6.5, 9.5]}, ";
const std::string handles =
    "handles:\n  - {name: a, region: {lattice: {i: [1, 2], k: [3, 3]}}}\n  - {name: b, region: {union: [{control: {ids: [0, "
    "1]}}]}}\n"
    "fixed: [{lattice: {j: [4, 4], k: [0, 1]}}]\n"
    "variables:\n  - {name: up, handle: a, translate: [0, 0, 1], upper: 0.5}\n"
    "  - {name: turn, handle: b, rotate: {axis: [0, 0, 1], centre: [1, 1, 1]}}\n";

TEST_F(RefinedLattice, MapsRegionsAndKeepsTheRest) {
  const RefinedSetup refined = refine(setup_text(box + "points: [5, 5, 4]", handles), {true, false, true});
  EXPECT_EQ(refined.before, (std::array<std::size_t, 3>{5, 5, 4}));
  EXPECT_FALSE(refined.mesh);
  const v1::Setup setup = read(refined);
  const v1::Lattice& lattice = setup.method().ffd().lattice();
  EXPECT_THAT(lattice.points(), testing::ElementsAre(7, 5, 5));
  EXPECT_TRUE(lattice.control_points().empty()) << "at rest";
  EXPECT_EQ(lattice.box().max(2), 9.5);
  EXPECT_EQ(setup.method().ffd().control(), v1::CONTROLS);
  // Uniform knots: i stands for 2 i - 1, and the last one for the last.
  const v1::LatticeRange& range = setup.handles(0).region().lattice();
  EXPECT_THAT(range.i(), testing::ElementsAre(1, 3));
  EXPECT_EQ(range.j_size(), 0);
  EXPECT_THAT(range.k(), testing::ElementsAre(4, 4));
  EXPECT_THAT(setup.handles(1).region().control().ids(), testing::ElementsAre(0, 1));
  EXPECT_THAT(setup.fixed(0).lattice().j(), testing::ElementsAre(4, 4));
  EXPECT_THAT(setup.fixed(0).lattice().k(), testing::ElementsAre(0, 1));
  EXPECT_EQ(setup.variables_size(), 2);
  EXPECT_EQ(setup.variables(0).upper(), 0.5);
  EXPECT_EQ(setup.handles(1).name(), "b");
}

/// Where a lattice takes the points of the mesh that lie in it.
std::vector<Vec3> through(const ControlLattice& lattice, const std::vector<Vec3>& u) {
  std::vector<Vec3> points;
  for (const Vec3& at : u) points.push_back(lattice.lattice.sum(lattice.places, at));
  return points;
}

TEST_F(RefinedLattice, TheDesignIsWhereTheNewSetupStarts) {
  for (const std::string basis : {"UNIFORM_CUBIC", "CLAMPED_CUBIC", "BERNSTEIN"}) {
    SCOPED_TRACE(basis);
    const std::string text = setup_text("basis: " + basis + ", " + box + "points: [5, 5, 4]", handles);
    const RefinedSetup refined = refine(text, {true, true, false}, {0.25, 0.1});
    ASSERT_TRUE(refined.mesh);
    EXPECT_EQ(refined.outside, 0u);
    // By direct evaluation of the coarse lattice.
    v1::Setup coarse_setup;
    parse_yaml(text, "setup.yaml", coarse_setup);
    ControlLattice coarse = control_lattice(coarse_setup, mesh_);
    coarse.places = moved_controls(coarse_setup, coarse, {0.25, 0.1});
    const std::vector<Vec3> u = coordinates_in(coarse.lattice, mesh_.points).u;
    const std::vector<Vec3> expected = through(coarse, u), got = through(refined.lattice, u);
    const double D = bounding_box(mesh_.points).diagonal();
    double moved = 0;
    for (std::size_t i = 0; i < u.size(); ++i) {
      ASSERT_LE(distance(got[i], expected[i]), 1e-12 * D);
      ASSERT_LE(distance((*refined.mesh)[i], expected[i]), 1e-12 * D);
      moved = std::max(moved, distance(expected[i], mesh_.points[i]));
    }
    EXPECT_GT(moved, 0.01);
    // The new setup, read back, has the moved points at the same coordinates of the finer lattice.
    const v1::Setup setup = read(refined);
    EXPECT_EQ(setup.geometry(), "");
    EXPECT_THAT(refined.text, HasSubstr("geometry: moved.obj"));
    Mesh mesh;
    mesh.points = *refined.mesh;
    const ControlLattice fine = control_lattice(setup, mesh);
    EXPECT_EQ(fine.places, refined.lattice.places);
    const LatticeCoordinates again = MovedLattice(fine.lattice, fine.places).coordinates(mesh.points);
    ASSERT_TRUE(again.outside.empty());
    for (std::size_t i = 0; i < u.size(); ++i) ASSERT_LE(distance(again.u[i], u[i]), 1e-11);
  }
}

TEST_F(RefinedLattice, OfAMovedLatticeIsMovedTheSameWay) {
  std::string csv = "x,y,z\n";
  for (int p = 0; p < 64; ++p) {
    csv += std::to_string(p % 4 * 1.2 - 0.3 + 0.02 * (p % 5)) + "," + std::to_string(p / 4 % 4 * 2.4 - 0.6 + 0.03 * (p % 3)) +
           "," + std::to_string(p / 16 * 3.4 - 0.6) + "\n";
  }
  write("start.csv", csv);
  const std::string text = setup_text("basis: CLAMPED_CUBIC, points: [4, 4, 4], control_points: {file: start.csv}",
                                      "handles: [{name: a, region: {control: {ids: [5]}}}]\n");
  const RefinedSetup refined = refine(text, {false, true, true});
  write("setup.yaml", text);
  const ControlLattice coarse = control_lattice(read_setup_file(folder_ / "setup.yaml").setup, mesh_);
  EXPECT_EQ(refined.lattice.lattice.size(), 4u * 5 * 5);
  for (const Vec3& u : {Vec3{0, 0, 0}, Vec3{0.3, 0.7, 0.2}, Vec3{1, 0.5, 0.9}}) {
    EXPECT_LE(distance(refined.lattice.lattice.sum(refined.lattice.places, u), coarse.lattice.sum(coarse.places, u)), 1e-13);
  }
  const v1::Setup setup = read(refined);
  EXPECT_EQ(setup.method().ffd().lattice().control_points().size(), 100 * sizeof(Vec3));
  EXPECT_TRUE(setup.method().ffd().lattice().has_box()) << "that of the mesh may become another one";
}

TEST_F(RefinedLattice, OfEnergyNeedsNoControlPoints) {
  const RefinedSetup refined =
      refine("geometry: box.obj\nmethod: {ffd: {}}\nhandles: [{name: a, region: {all: true}}]\n", {true, true, true});
  const v1::Setup setup = read(refined);
  EXPECT_EQ(setup.method().ffd().lattice().points(2), 2 * refined.before[2] - 3);
  EXPECT_TRUE(setup.handles(0).region().all());
}

TEST_F(RefinedLattice, RefusesWhatCannotBe) {
  const std::string energy =
      "geometry: box.obj\nmethod: {ffd: {lattice: {points: [5, 5, 4]}}}\nhandles: [{name: a, region: {all: true}}]\n"
      "variables: [{name: up, handle: a, translate: [0, 0, 1]}]\n";
  expect_error(ErrorCode::invalid_argument, {"--set", "CONTROLS"}, [&] { refine(energy, {true, true, true}, {1}); });
  expect_error(ErrorCode::invalid_argument, {"method", "ffd"}, [&] {
    refine("geometry: box.obj\nmethod: {rbf: {}}\n", {true, true, true});
  });
  expect_error(ErrorCode::invalid_argument, {"method.ffd.lattice.points", "1017", "1000"}, [&] {
    refine(setup_text(box + "points: [510, 4, 4]", handles), {true, false, false});
  });
  expect_error(ErrorCode::invalid_argument, {"method.ffd.lattice.points", "100000"}, [&] {
    refine(setup_text(box + "points: [60, 60, 20]", handles), {true, false, false});
  });
  expect_error(ErrorCode::invalid_argument, {"10000", "not at rest"}, [&] {
    refine(setup_text(box + "points: [20, 20, 20]", handles), {true, false, false}, {0.1, 0});
  });
  expect_error(ErrorCode::invalid_argument, {"method.ffd.lattice.points", "16", "Bernstein"}, [&] {
    refine(setup_text("basis: BERNSTEIN, points: [16, 5, 4]", handles), {true, false, false});
  });
  expect_error(ErrorCode::invalid_argument, {"variable \"up\"", "0.6"}, [&] {
    refine(setup_text(box + "points: [5, 5, 4]", handles), {true, false, false}, {0.6, 0});
  });
}

}  // namespace
}  // namespace deform::cli::refined_setup_test
