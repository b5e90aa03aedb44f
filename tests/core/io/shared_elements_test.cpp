// SPDX-License-Identifier: GPL-3.0-or-later
// Every shared Gmsh mesh and Abaqus deck: read with the counts that are published with it, written back undeformed byte for byte,
// and deformed with nothing but coordinates changed.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "core/io/mesh_file.h"
#include "core/mesh/inspect.h"
#include "core/quality/element_quality.h"
#include "tests/core/io/text_diff.h"

namespace deform::io::shared_elements_test {
namespace {

namespace fs = std::filesystem;

const fs::path folder = fs::path(DEFORM_SHARED_DATA) / "B_volume";

struct SharedFile {
  const char* path;
  std::size_t points, faces, elements;
  double least_scaled_jacobian;  // as published, to three digits; 0: it has none
  std::vector<std::string> groups = {};
};

std::ostream& operator<<(std::ostream& out, const SharedFile& file) { return out << file.path; }

/// "NAME1" .. "NAME<count>", then `last`.
std::vector<std::string> numbered(const std::string& name, int count, const std::string& last) {
  std::vector<std::string> names;
  for (int i = 1; i <= count; ++i) names.push_back(name + std::to_string(i));
  names.push_back(last);
  return names;
}

const std::vector<SharedFile> shared_files = {
    {"abaqus/beam8t.inp.gz", 425, 288, 256, 1, {"NALL", "FIX", "Eall", "E1", "E2"}},
    {"abaqus/hueeber1.inp.gz",
     17524,
     17520,
     8500,
     1,
     {"Smast", "Sslav", "Nall", "Ncopy1", "Ncopy2", "Ncopy1_l1", "Ncopy1_l2", "Ncopy1_l3", "Ncopy1_r1", "Ncopy1_r2", "Ncopy1_r3",
      "Nout", "Eall", "Ecopy1", "Ecopy2"}},
    {"abaqus/rotor.inp.gz", 2656, 768, 368, 0, {"Nall", "Nfix", "Eall"}},
    {"abaqus/segmenttet.inp.gz", 2756, 700, 1489, 0, {"Nall", "Nleft", "Nright", "Eall", "left", "right"}},
    {"external/ahmed_domain_tet_cadclassified.msh.gz",
     15665,
     13072,
     77100,
     0.0882,
     {"body", "inlet", "sides", "ground", "outlet", "volume"}},
    {"gmsh/piece.asc.v22.msh.gz", 3939, 6668, 13179, 0.0147},
    {"gmsh/piece.asc.v40.msh.gz", 4096, 6756, 13676, 0.155},
    {"gmsh/piece.asc.v41.msh.gz", 4094, 6950, 13370, 0.119},
    {"gmsh/piece.bin.v22.msh.gz", 3939, 6668, 13179, 0.0147},
    {"gmsh/piece.bin.v41.msh.gz", 4094, 6950, 13370, 0.119},
    {"mambo/mambo_s1_tet_cadclassified.msh.gz", 2146, 3594, 7332, 0.0325, numbered("face", 14, "volume")},
    {"mambo/mambo_s22_tet_cadclassified.msh.gz", 2917, 4512, 10601, 0.118, numbered("face", 30, "volume")},
    {"param/bore_tet_p0.msh.gz", 2505, 2868, 10853, 0.164, {"side", "top", "bottom", "hole", "volume"}},
    {"param/bore_tet_p0_cadclassified.msh.gz", 2505, 2868, 10853, 0.164, {"side", "top", "bottom", "hole", "volume"}},
    {"param/pipe_hex_p0.inp.gz", 10720, 4480, 8448, 0.994, {"inlet", "inner", "outer", "outlet"}},
    {"param/pipe_tet_p0.msh.gz", 4353, 7398, 15331, 0.141, {"outer", "inlet", "inner", "outlet", "volume"}},
    {"param/pipe_tet_p0_cadclassified.msh.gz", 4353, 7398, 15331, 0.141, {"outer", "inlet", "inner", "outlet", "volume"}},
};

/// Numbers between commas as words.
std::string with_blanks(std::string text) {
  std::replace(text.begin(), text.end(), ',', ' ');
  return text;
}

class SharedElements : public testing::TestWithParam<SharedFile> {
 protected:
  const fs::path path_ = folder / GetParam().path;
  const std::string bytes_ = read_file(path_);  // unpacked
  const std::unique_ptr<MeshFile> file_ = read_mesh_file(path_);
  const std::shared_ptr<const Mesh> mesh_ = file_->mesh();
};

TEST_P(SharedElements, HasTheCountsOfItsProvenance) {
  EXPECT_EQ(mesh_->point_count(), GetParam().points);
  EXPECT_EQ(mesh_->face_count(), GetParam().faces);
  std::vector<std::string> names;
  for (const Group& group : mesh_->groups) names.push_back(group.name);
  EXPECT_EQ(names, GetParam().groups);
  ASSERT_EQ(file_->elements()->size(), GetParam().elements);
  const ElementQuality quality = element_quality(mesh_->points, *file_->elements());
  EXPECT_EQ(quality.inverted_elements, 0u);
  if (GetParam().least_scaled_jacobian == 0) return;
  // The table has VTK's measure, of which a regular tetrahedron has 1 instead of the sine of its corners.
  const double regular = file_->elements()->types[0] == ElementType::tetrahedron ? std::sqrt(0.5) : 1;
  EXPECT_NEAR(quality.least_scaled_jacobian.value / regular, GetParam().least_scaled_jacobian, 0.0006)
      << "half a unit of the last digit printed";
}

TEST_P(SharedElements, UndeformedPointsGiveTheSameBytes) { EXPECT_EQ(file_->with_points(mesh_->points), bytes_); }

TEST_P(SharedElements, DeformedPointsChangeNothingButCoordinates) {
  const double size = bounding_box(mesh_->points).diagonal();
  Points moved = mesh_->points;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const double shift = 1.0 / 3 + 1e-7 * static_cast<double>(i % 1000);
    for (int k = 0; k < 3; ++k) moved[i][k] = moved[i][k] * 1.25 + size * (shift + 0.1 * k);
  }
  const std::string written = file_->with_points(moved);
  const auto back = parse_mesh(written, path_.string());
  EXPECT_EQ(back->mesh()->face_points, mesh_->face_points);
  EXPECT_EQ(back->elements()->points, file_->elements()->points);
  ASSERT_EQ(back->mesh()->point_count(), moved.size());
  // Abaqus reads numbers of at most 20 characters, which hold 13 digits at least.
  const double rounding = file_->format() == Format::abaqus ? 1e-13 : 0;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    for (int k = 0; k < 3; ++k) {
      ASSERT_LE(std::abs(back->mesh()->points[i][k] - moved[i][k]), rounding * std::abs(moved[i][k])) << "point " << i;
    }
  }
  if (bytes_.find('\0') == std::string::npos) {
    const auto changed = test::changed_words(with_blanks(bytes_), with_blanks(written));
    EXPECT_EQ(changed.size(), 3 * moved.size());
    EXPECT_NE(changed[0], -1);
  } else {
    ASSERT_EQ(written.size(), bytes_.size());
    std::size_t changed = 0;
    for (std::size_t i = 0; i < written.size(); ++i) changed += written[i] != bytes_[i];
    EXPECT_LE(changed, 24 * moved.size());
  }
}

INSTANTIATE_TEST_SUITE_P(All, SharedElements, testing::ValuesIn(shared_files), [](const auto& tested) {
  std::string name = tested.param.path;
  std::replace_if(
      name.begin(), name.end(), [](char c) { return !std::isalnum(static_cast<unsigned char>(c)); }, '_');
  return name;
});

TEST(SharedElementsFolders, NoFileIsLeftOut) {
  std::vector<std::string> found, expected;
  for (const SharedFile& file : shared_files) expected.push_back((folder / file.path).string());
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const std::string name = entry.path().string();
    if (name.ends_with(".msh.gz") || name.ends_with(".inp.gz")) found.push_back(name);
  }
  EXPECT_THAT(found, testing::UnorderedElementsAreArray(expected));
}

}  // namespace
}  // namespace deform::io::shared_elements_test
