// SPDX-License-Identifier: GPL-3.0-or-later
// Every shared SU2, VTK and VTU mesh: counts and quality that are published with it, written back undeformed byte for byte, and
// deformed with the same cells.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "core/io/mesh_file.h"
#include "core/quality/element_quality.h"
#include "tests/core/io/text_diff.h"
#include "tests/support/expect_error.h"

namespace deform::io::shared_grids_test {
namespace {

namespace fs = std::filesystem;

const fs::path folder = fs::path(DEFORM_SHARED_DATA) / "B_volume";

struct SharedGrid {
  const char* path;
  std::size_t points, elements, faces;
  double scaled_jacobian;  ///< the least, as Verdict measures it
  std::vector<std::string> groups = {};
};
std::ostream& operator<<(std::ostream& out, const SharedGrid& grid) { return out << grid.path; }

class SharedGridTest : public testing::TestWithParam<SharedGrid> {
 protected:
  const std::string bytes_ = read_file(folder / GetParam().path);  // unpacked
  const std::unique_ptr<MeshFile> file_ = read_mesh_file(folder / GetParam().path);
};

TEST_P(SharedGridTest, HasTheNumbersOfItsProvenance) {
  const auto mesh = file_->mesh();
  EXPECT_EQ(mesh->point_count(), GetParam().points);
  EXPECT_EQ(mesh->face_count(), GetParam().faces);
  std::vector<std::string> names;
  for (const Group& group : mesh->groups) {
    names.push_back(group.name);
    EXPECT_EQ(group.points.empty(), file_->elements() != nullptr) << group.name << ": faces, and in two dimensions points";
  }
  EXPECT_EQ(names, GetParam().groups);
  EXPECT_EQ(file_->elements() == nullptr, GetParam().elements == 0);
  if (GetParam().elements == 0) return;
  const auto quality = element_quality(mesh->points, *file_->elements());
  EXPECT_EQ(quality.elements, GetParam().elements);
  const double verdict = file_->elements()->types[0] == ElementType::tetrahedron ? std::sqrt(2) : 1;
  EXPECT_NEAR(quality.least_scaled_jacobian.value * verdict, GetParam().scaled_jacobian, 0.005 * GetParam().scaled_jacobian);
}

TEST_P(SharedGridTest, OnlyCoordinatesChange) {
  const auto mesh = file_->mesh();
  EXPECT_EQ(file_->with_points(mesh->points), bytes_);
  const bool flat = file_->elements() == nullptr;
  Points moved = mesh->points;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    for (int k = 0; k < (flat ? 2 : 3); ++k) moved[i][k] = 1.25 * moved[i][k] + 1.0 / 3 + 1e-7 * static_cast<double>(i % 1000);
  }
  const std::string written = file_->with_points(moved);
  const auto back = parse_mesh(written, GetParam().path);
  EXPECT_EQ(back->mesh()->points, moved);
  EXPECT_EQ(back->mesh()->face_points, mesh->face_points);
  EXPECT_EQ(back->mesh()->groups.size(), mesh->groups.size());
  if (!flat) {
    EXPECT_EQ(back->elements()->points, file_->elements()->points);
  }
  if (file_->format() != Format::vtu) {
    EXPECT_EQ(test::changed_words(bytes_, written).size(), (flat ? 2 : 3) * mesh->point_count());
  }
  if (!flat) return;
  moved.back()[2] += 1e-6;
  test::expect_error(ErrorCode::invalid_argument, {"two-dimensional"}, [&] { file_->with_points(moved); });
}

INSTANTIATE_TEST_SUITE_P(
    All, SharedGridTest,
    testing::Values(SharedGrid{"su2/mesh_NACA0012_inv.su2.gz", 5233, 0, 10216, 0, {"airfoil", "farfield"}},
                    SharedGrid{"su2/mesh_cantilever.su2", 1111, 0, 1000, 0, {"left", "upper", "right", "clamped"}},
                    SharedGrid{"external/oneraM6_tet.su2.gz",
                               16144,
                               77921,
                               13746,
                               0.00456,
                               {"farfield", "symmetry", "tip", "trailing_edge", "wing_lower", "wing_upper"}},
                    SharedGrid{"param/pipe_tet_p0.su2.gz", 4353, 15331, 7398, 0.141, {"inlet", "inner", "outer", "outlet"}},
                    SharedGrid{"param/bore_hex_p0.vtk.gz", 6760, 5760, 1920, 0.707},
                    SharedGrid{"param/bore_hex_p1_reference.vtu", 6760, 5760, 1920, 0.456},
                    SharedGrid{"param/bore_tet_p1_reference.vtu", 2505, 10853, 2868, 0.037},
                    SharedGrid{"param/pipe_hex_p0.vtu", 10720, 8448, 4480, 0.994},
                    SharedGrid{"param/pipe_hex_p1_reference.vtu", 10720, 8448, 4480, 0.995},
                    SharedGrid{"param/pipe_tet_p1_reference.vtu", 4353, 15331, 7398, 0.0174},
                    SharedGrid{"external/ahmed_domain_tet.vtu", 15665, 77100, 13072, 0.0882},
                    SharedGrid{"mambo/mambo_s22_tet.vtu", 2917, 10601, 4512, 0.118}),
    [](const auto& tested) {
      std::string name = fs::path(tested.param.path).filename().string();
      std::replace_if(
          name.begin(), name.end(), [](char c) { return c == '.'; }, '_');
      return name;
    });

TEST(SharedGrids, NoFileIsLeftOut) {
  std::size_t found = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    std::string name = entry.path().filename().string();
    if (name.ends_with(".gz")) name.resize(name.size() - 3);
    for (const char* extension : {".su2", ".vtk", ".vtu", ".vtp"}) found += name.ends_with(extension) ? 1 : 0;
  }
  EXPECT_EQ(found, 12u);
}

}  // namespace
}  // namespace deform::io::shared_grids_test
