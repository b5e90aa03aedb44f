// SPDX-License-Identifier: GPL-3.0-or-later
// The numbers that OpenFOAM's checkMesh printed for every shared case, to three digits and better; inversions of real cells.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <regex>

#include "core/io/mesh_file.h"
#include "core/quality/polyhedral_quality.h"
#include "tests/core/quality/cell_by_cell.h"

namespace deform::shared_data_test {
namespace {

namespace fs = std::filesystem;

/// The number behind `label` in the text of checkMesh.
double printed(const std::string& text, const std::string& label) {
  const std::regex pattern(label + R"(\s*=?\s*([-+0-9.e]+[0-9]))");
  std::smatch match;
  if (!std::regex_search(text, match, pattern)) throw std::runtime_error("checkMesh did not print " + label);
  return std::stod(match[1]);
}

class CheckMesh : public testing::TestWithParam<const char*> {};

TEST_P(CheckMesh, PrintsTheSameNumbers) {
  const fs::path folder = fs::path(DEFORM_SHARED_DATA) / "B_volume" / "openfoam" / GetParam();
  const std::string log = io::read_file(folder / "checkMesh.baseline.log");
  const auto file = io::read_mesh_file(folder);
  const PolyhedralQuality quality = polyhedral_quality(file->mesh()->points, *file->cells());
  const auto same = [&](const std::string& label, double ours) {
    const double theirs = printed(log, label);
    EXPECT_NEAR(ours, theirs, 1e-6 * std::abs(theirs)) << label;
  };
  EXPECT_EQ(quality.cells, static_cast<std::size_t>(printed(log, "cells:")));
  EXPECT_EQ(quality.faces, static_cast<std::size_t>(printed(log, "    faces:")));
  EXPECT_EQ(quality.internal_faces, static_cast<std::size_t>(printed(log, "internal faces:")));
  same("Min volume", quality.least_volume.value);
  same("Max volume", quality.largest_volume.value);
  same("Total volume", quality.total_volume);
  same("Minimum face area", quality.least_area.value);
  same("Maximum face area", quality.largest_area.value);
  same("Mesh non-orthogonality Max:", quality.largest_non_orthogonality.value);
  same("average:", quality.average_non_orthogonality);
  same("Max skewness", quality.largest_skewness.value);
  same("Max aspect ratio", quality.largest_aspect_ratio.value);
  EXPECT_EQ(quality.non_orthogonal_faces, log.find("severely non-orthogonal") == std::string::npos ? 0u : 1u);
  EXPECT_EQ(quality.failed_checks(), 0u) << "what fails in airFoil2D is its topology";
}

INSTANTIATE_TEST_SUITE_P(All, CheckMesh, testing::Values("airFoil2D", "car_fastback", "pipe_poly", "pipe_tet"),
                         [](const auto& tested) { return std::string(tested.param); });

class RealCells : public testing::TestWithParam<const char*> {};

// Polyhedra, tetrahedra, layers, slivers and quadratic elements: bent more and more, by what is looked at and by every cell.
TEST_P(RealCells, SameAnswersAsCellByCell) {
  const auto file = io::read_mesh_file(fs::path(DEFORM_SHARED_DATA) / "B_volume" / GetParam());
  const auto mesh = file->mesh();
  const auto cells = cell_set(*mesh);
  ASSERT_TRUE(cells.has_value());
  const InversionCheck check(mesh->points, *cells);
  const double diagonal = bounding_box(mesh->points).diagonal();
  std::size_t inverting = 0, cleared = 0;
  for (const double by : {1e-4, 0.01, 0.1, 0.5}) {
    SCOPED_TRACE(by);
    Points to = mesh->points;
    for (Vec3& p : to) {
      const Vec3 x = p;
      for (std::size_t k = 0; k < 3; ++k)
        p[k] += by * diagonal * std::sin(5 / diagonal * x[(k + 1) % 3] + static_cast<double>(k));
    }
    const SafeAmplitude found = check.amplitude(mesh->points, to);
    test::expect_same(found, test::cell_by_cell(mesh->points, mesh->points, to, *cells));
    inverting += found.amplitude < 1;
    cleared += found.suspects < check.cell_count() / 20;
  }
  EXPECT_GE(inverting, 1u);
  EXPECT_GE(cleared, 1u);
}

INSTANTIATE_TEST_SUITE_P(All, RealCells,
                         testing::Values("openfoam/airFoil2D", "openfoam/pipe_poly", "openfoam/pipe_tet",
                                         "exodus/simple-cube-pyramid5.e", "exodus/simple-cube-wedge6.e",
                                         "abaqus/segmenttet.inp.gz", "hex_medit/block_in.mesh"),
                         [](const auto& tested) {
                           std::string name = tested.param;
                           for (char& c : name) c = std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
                           return name;
                         });

}  // namespace
}  // namespace deform::shared_data_test
