// SPDX-License-Identifier: GPL-3.0-or-later
// Every shared CGNS and Exodus mesh: read with the counts and qualities that are published with it, written back undeformed byte
// for byte, and deformed with nothing but coordinates changed.

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "core/io/mesh_file.h"
#include "core/quality/element_quality.h"

namespace deform::io::shared_containers_test {
namespace {

namespace fs = std::filesystem;

const fs::path volumes = fs::path(DEFORM_SHARED_DATA) / "B_volume";

struct Container {
  const char* path;
  std::size_t points, faces, elements;
  std::vector<std::string> groups;
  double least = 0, average = 0;  ///< scaled Jacobian where the table has it, of tetrahedra as Verdict says
};
std::ostream& operator<<(std::ostream& out, const Container& file) { return out << file.path; }

const std::vector<Container>& containers() {
  static const std::vector<Container> all{
      {"cgns/mesh_wedge_inv.cgns", 3750, 3626, 0, {"inlet", "lower", "outlet", "upper", "QuadElements"}},
      {"param/pipe_tet_p0.cgns", 4353, 7398, 15331, {"inlet", "inner", "outer", "outlet"}, 0.141, 0.561},
      {"exodus/block-names.e",
       27,
       24,
       8,
       {"back", "bottom", "right", "top", "left", "front", "pointZone:back", "pointZone:bottom", "pointZone:right",
        "pointZone:top", "pointZone:left", "pointZone:front"},
       1,
       1},
      {"exodus/simple-cube-hex8.e", 64, 54, 27, {"bottom", "top"}, 1, 1},
      {"exodus/simple-cube-multi-element-order1.e", 719, 560, 1322, {"top", "bottom", "hex8", "tet4", "wedge6", "pyramid5"}},
      {"exodus/simple-cube-pyramid5.e", 341, 150, 750, {"top", "bottom"}},
      {"exodus/simple-cube-tet10.e", 568, 156, 295, {"bottom", "top"}},
      {"exodus/simple-cube-tet4.e", 98, 156, 295, {"bottom", "top"}},
      {"exodus/simple-cube-wedge6.e", 216, 200, 250, {"top", "bottom"}},
      {"mambo/mambo_s1_tet.e",
       2146,
       3594,
       7332,
       {"face1", "face10", "face11", "face12", "face13", "face14", "face2", "face3", "face4", "face5", "face6", "face7", "face8",
        "face9"},
       0.0325,
       0.565},
      {"param/bore_hex_p0.e", 6760, 1920, 5760, {"bottom", "hole", "side", "top"}, 0.707, 0.923},
      {"param/bore_tet_p0.e", 2505, 2868, 10853, {"bottom", "hole", "side", "top"}, 0.164, 0.596}};
  return all;
}

class SharedContainer : public testing::TestWithParam<Container> {
 protected:
  const fs::path path_ = volumes / GetParam().path;
  const std::string bytes_ = read_file(path_);
  const std::unique_ptr<MeshFile> file_ = read_mesh_file(path_);
};

TEST_P(SharedContainer, HasTheCountsOfItsProvenance) {
  const auto mesh = file_->mesh();
  ASSERT_NO_THROW(mesh->validate());
  EXPECT_EQ(mesh->point_count(), GetParam().points);
  EXPECT_EQ(mesh->face_count(), GetParam().faces);
  std::vector<std::string> names;
  for (const Group& group : mesh->groups) names.push_back(group.name);
  EXPECT_THAT(names, testing::UnorderedElementsAreArray(GetParam().groups));
  ASSERT_EQ(file_->elements() != nullptr, GetParam().elements > 0);
  if (GetParam().elements == 0) return;
  const ElementQuality q = element_quality(mesh->points, *file_->elements());
  EXPECT_EQ(q.elements, GetParam().elements);
  EXPECT_EQ(q.inverted_elements, 0u);
  if (GetParam().least == 0) return;
  const bool tetrahedra = q.of_type[static_cast<std::size_t>(ElementType::tetrahedron)].elements > 0;
  const double factor = tetrahedra ? std::sqrt(2) : 1;
  EXPECT_NEAR(factor * q.least_scaled_jacobian.value, GetParam().least, 0.0005);
  EXPECT_NEAR(factor * q.average_scaled_jacobian, GetParam().average, 0.0005);
}

TEST_P(SharedContainer, UndeformedPointsGiveTheSameBytes) { EXPECT_EQ(file_->with_points(file_->mesh()->points), bytes_); }

TEST_P(SharedContainer, DeformedPointsChangeNothingButCoordinates) {
  const auto mesh = file_->mesh();
  Points moved = mesh->points;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) moved[i][k] = 1.25 * moved[i][k] + 0.1 + 1e-7 * static_cast<double>(i % 1000);
  }
  const std::string written = file_->with_points(moved);
  const auto back = parse_mesh(written, path_.string());
  EXPECT_EQ(back->mesh()->points, moved);
  EXPECT_EQ(back->mesh()->face_points, mesh->face_points);
  EXPECT_EQ(back->mesh()->groups.size(), mesh->groups.size());
  if (file_->elements()) {
    EXPECT_EQ(back->elements()->points, file_->elements()->points);
  }
  // Bytes of doubles only, and with the old points the old file again.
  ASSERT_EQ(written.size(), bytes_.size());
  std::size_t changed = 0;
  for (std::size_t i = 0; i < written.size(); ++i) changed += written[i] != bytes_[i];
  EXPECT_LE(changed, 24 * moved.size());
  EXPECT_GT(changed, 3 * moved.size());
  EXPECT_EQ(back->with_points(mesh->points), bytes_);
}

INSTANTIATE_TEST_SUITE_P(All, SharedContainer, testing::ValuesIn(containers()), [](const auto& tested) {
  std::string name = tested.param.path;
  std::replace_if(
      name.begin(), name.end(), [](char c) { return !std::isalnum(static_cast<unsigned char>(c)); }, '_');
  return name;
});

TEST(SharedContainers, NoFileIsLeftOut) {
  std::vector<std::string> found, expected;
  for (const Container& file : containers()) expected.emplace_back(file.path);
  for (const auto& entry : fs::recursive_directory_iterator(volumes)) {
    const std::string extension = entry.path().extension();
    if (extension == ".e" || extension == ".cgns") found.push_back(fs::relative(entry.path(), volumes).string());
  }
  EXPECT_THAT(found, testing::UnorderedElementsAreArray(expected));
}

// The linear and the quadratic tetrahedra are the same cube; the mid nodes lie amid straight edges.
TEST(SharedContainers, QuadraticTetrahedra) {
  const auto linear = read_mesh_file(volumes / "exodus/simple-cube-tet4.e"),
             quadratic = read_mesh_file(volumes / "exodus/simple-cube-tet10.e");
  const ElementQuality a = element_quality(linear->mesh()->points, *linear->elements());
  const ElementQuality b = element_quality(quadratic->mesh()->points, *quadratic->elements());
  EXPECT_NEAR(a.least_scaled_jacobian.value, b.least_scaled_jacobian.value, 1e-12);
  EXPECT_NEAR(a.average_scaled_jacobian, b.average_scaled_jacobian, 1e-12);
  EXPECT_NEAR(a.largest_aspect_ratio.value, b.largest_aspect_ratio.value, 1e-11);
  EXPECT_NEAR(b.total_volume, 1, 1e-12);
}

}  // namespace
}  // namespace deform::io::shared_containers_test
