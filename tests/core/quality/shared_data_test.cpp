// SPDX-License-Identifier: GPL-3.0-or-later
// The numbers that OpenFOAM's checkMesh printed for every shared case, to three digits and better.
#include <gtest/gtest.h>

#include <filesystem>
#include <regex>

#include "core/io/mesh_file.h"
#include "core/quality/polyhedral_quality.h"

namespace deform {
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

}  // namespace
}  // namespace deform
