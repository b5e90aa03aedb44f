// SPDX-License-Identifier: GPL-3.0-or-later
// Every shared surface, Medit and OpenFOAM mesh: read with the counts that are published with it, written back undeformed byte
// for byte, and deformed with nothing but coordinates changed.

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>

#include "core/io/mesh_file.h"
#include "core/mesh/inspect.h"
#include "tests/core/io/text_diff.h"
#include "tests/support/expect_error.h"

namespace deform::io::shared_data_test {
namespace {

namespace fs = std::filesystem;

const fs::path shared_data = DEFORM_SHARED_DATA;

struct SharedFile {
  const char* path;
  std::size_t points, faces;
  std::vector<std::string> groups = {};
};

std::ostream& operator<<(std::ostream& out, const SharedFile& file) { return out << file.path; }

const std::vector<SharedFile>& shared_files() {
  static const std::vector<SharedFile> files = {
      {"A_surface/ChineseDragon-10kv.off.gz", 10000, 19994},
      {"A_surface/DTC-scaled.stl.gz", 58033, 116062, {"ascii"}},
      {"A_surface/NACA0012.obj.gz", 7996, 15988, {"airfoil"}},
      {"A_surface/ahmed_slant25.stl.gz", 6695, 13386, {"body", "slant", "base", "stilts"}},
      {"A_surface/anchor_dense.off.gz", 3793, 7598},
      {"A_surface/beetle.off", 5105, 9664},
      {"A_surface/beetle.off.gz", 19887, 38656},
      {"A_surface/bumpy-cube.obj.gz", 19970, 39936},
      {"A_surface/car_fastback.stl.gz",
       22259,
       44498,
       {"body", "wheelhouse_fl", "wheelhouse_fr", "wheelhouse_rl", "wheelhouse_rr", "wheel_fl", "wheel_fr", "wheel_rl",
        "wheel_rr"}},
      {"A_surface/fandisk.off.gz", 6475, 12946},
      {"A_surface/fandisk_dual.off.gz", 12946, 6475},
      {"A_surface/fandisk_quads.off", 766, 764},
      {"A_surface/flange.stl.gz", 3228, 6468, {"patch1", "patch2", "patch3", "patch4"}},
      {"A_surface/joint.off", 221, 446},
      {"A_surface/joint_remeshed.off.gz", 8380, 16764},
      {"A_surface/lion_vase_poly.off.gz", 46206, 23105},
      {"A_surface/oneraM6_wing.off.gz", 5414, 10764},
      {"A_surface/pinion.off", 650, 1300},
      {"A_surface/pipe.off", 160, 320},
      {"A_surface/plane.off", 841, 1600},
      {"A_surface/plane_1100.off", 1100, 2064},
      {"A_surface/propellerTip.obj.gz", 16785, 33432, {"ascii"}},
      {"A_surface/rocker-arm.obj.gz", 10044, 20088},
      {"A_surface/sphere_7800.off.gz", 7800, 15596},
      {"A_surface/spool.off", 649, 1294},
      {"B_volume/hex_medit/block_in.mesh", 3180, 1200, {"ref_1"}},
      {"B_volume/hex_medit/block_out.mesh", 3180, 1200, {"ref_1"}},
      {"B_volume/hex_medit/block_stresstest_in.mesh", 3180, 1200, {"ref_1"}},
      {"B_volume/hex_medit/cap_in.mesh.gz", 5449, 1950, {"ref_1"}},
      {"B_volume/hex_medit/cap_out.mesh.gz", 5449, 1950, {"ref_1"}},
      {"B_volume/hex_medit/rockerarm.mesh.gz", 12751, 4076, {"ref_0"}},
      {"B_volume/tet_medit/hand.mesh.gz", 7234, 9556, {"ref_0"}},
      {"B_volume/tet_medit/octopus-low.mesh", 452, 898, {"ref_0"}},
      {"B_volume/tet_medit/sphere.mesh.gz", 4505, 2880, {"ref_0"}},
      {"C_defects/angle_block.STL", 398, 704},
      {"C_defects/b9_mesh.off.gz", 5951, 10174},
      {"C_defects/beetle.obj", 1148, 2053, {"VWBUG", "None"}},
      {"C_defects/blobby-shuffled.off", 2027, 4050},
      {"C_defects/boeing.off", 2741, 2564},
      {"C_defects/box.STL.gz", 4455, 8954},
      {"C_defects/chair_model.obj.gz",
       3186,
       12756,
       {"mesh20_mesh20-geometry", "material_0_1_8", "material_1_24", "mesh17_mesh17-geometry", "material_2_24",
        "mesh9.001_mesh9-geometry", "mesh1.001_mesh1-geometry"}},
      {"C_defects/comments.off", 8, 6},
      {"C_defects/cow.off", 2904, 5804},
      {"C_defects/cube-ouvert.off", 9, 10},
      {"C_defects/degtri_sliding.off", 8, 8},
      {"C_defects/dragon_res4.ply.gz", 5205, 11102},
      {"C_defects/joined_tetrahedra.obj", 5, 8, {"bottom"}},
      {"C_defects/mask_cone.off", 1230, 2332},
      {"C_defects/mech-holes-shark.off.gz", 5246, 10192},
      {"C_defects/motor.stl.gz", 6635, 13506, {"solid_1"}},
      {"C_defects/mpi.off", 90, 52},
      {"C_defects/negative_indices.obj", 8, 6},
      {"C_defects/notenoughindices.obj", 3, 2, {"textureSurface", "Material"}},
      {"C_defects/propeller.stl.gz", 3689, 7375, {"solid_1"}},
      {"C_defects/quads_to_stitch.off", 20, 8},
      {"C_defects/shared.STL", 14, 24},
      {"C_defects/soup.stl", 300, 100},
      {"C_defects/sparger.stl.gz", 560, 972, {"sparger"}},
      {"C_defects/tetra_intersected_by_triangle.off", 7, 5},
      {"C_defects/truck.obj", 2956, 4770},
      {"C_defects/wallhole.obj", 92, 13},
      {"C_defects/whitespace.off", 8, 6},
  };
  return files;
}

class SharedDataTest : public testing::TestWithParam<SharedFile> {
 protected:
  SharedDataTest() : path_(shared_data / GetParam().path), bytes_(read_file(path_)), file_(read_mesh_file(path_)) {}

  const fs::path path_;
  const std::string bytes_;  // unpacked
  const std::unique_ptr<MeshFile> file_;
};

TEST_P(SharedDataTest, HasTheCountsOfItsProvenance) {
  const auto mesh = file_->mesh();
  ASSERT_NO_THROW(mesh->validate());
  EXPECT_EQ(mesh->point_count(), GetParam().points);
  EXPECT_EQ(mesh->face_count(), GetParam().faces);
  std::vector<std::string> names;
  for (const Group& group : mesh->groups) names.push_back(group.name);
  EXPECT_EQ(names, GetParam().groups);
  EXPECT_EQ(file_->compressed, path_.extension() == ".gz");
}

TEST_P(SharedDataTest, UndeformedPointsGiveTheSameBytes) { EXPECT_EQ(file_->with_points(file_->mesh()->points), bytes_); }

/// Moves every coordinate of every point, by a different amount.
Points deformed(const Points& points) {
  const double size = bounding_box(points).diagonal();
  Points moved = points;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const double shift = 1.0 / 3 + 1e-7 * static_cast<double>(i % 1000);
    for (int k = 0; k < 3; ++k) moved[i][k] = points[i][k] * 1.25 + size * (shift + 0.1 * k);
  }
  return moved;
}

/// Through memory on purpose: GCC 12 at -O2 drops the rounding of double -> float -> double where it vectorizes several in a row.
double nearest_float(double value) {
  const volatile float rounded = static_cast<float>(value);
  return rounded;
}

TEST_P(SharedDataTest, DeformedPointsChangeNothingButCoordinates) {
  const auto mesh = file_->mesh();
  const Points moved = deformed(mesh->points);
  const std::string written = file_->with_points(moved);
  const auto back = parse_mesh(written, path_.string())->mesh();

  const bool binary = written.find('\0') != std::string::npos;
  ASSERT_EQ(back->face_sizes, mesh->face_sizes);
  ASSERT_EQ(back->face_points.size(), mesh->face_points.size());
  const auto expected = [&](std::size_t point) {
    Vec3 p = moved[point];
    if (binary) p = {nearest_float(p[0]), nearest_float(p[1]), nearest_float(p[2])};
    return p;
  };
  // Corner by corner: rounding to floats may make corners of an STL file coincide.
  for (std::size_t c = 0; c < mesh->face_points.size(); ++c) {
    ASSERT_EQ(back->points[back->face_points[c]], expected(mesh->face_points[c])) << "corner " << c;
  }
  if (file_->format() != Format::stl) {
    ASSERT_EQ(back->point_count(), mesh->point_count());
    for (std::size_t i = 0; i < mesh->point_count(); ++i) ASSERT_EQ(back->points[i], expected(i)) << "point " << i;
  }

  const bool stl = file_->format() == Format::stl;
  const std::size_t records = stl ? mesh->face_points.size() + mesh->face_count() : mesh->point_count();  // with facet normals
  if (binary) {
    ASSERT_EQ(written.size(), bytes_.size());
    std::size_t changed = 0;
    for (std::size_t i = 0; i < written.size(); ++i) changed += written[i] != bytes_[i];
    EXPECT_LE(changed, 12 * records);
  } else {
    const auto changed = test::changed_words(bytes_, written);
    // The normal of a facet may keep some of its words.
    EXPECT_LE(changed.size(), 3 * records);
    EXPECT_GE(changed.size(), 3 * (stl ? mesh->face_points.size() : records));
    ASSERT_FALSE(changed.empty());
    EXPECT_NE(changed[0], -1);
  }
}

INSTANTIATE_TEST_SUITE_P(All, SharedDataTest, testing::ValuesIn(shared_files()), [](const auto& tested) {
  std::string name = tested.param.path;
  std::replace_if(
      name.begin(), name.end(), [](char c) { return !std::isalnum(static_cast<unsigned char>(c)); }, '_');
  return name;
});

class SharedFoamTest : public testing::TestWithParam<SharedFile> {};

TEST_P(SharedFoamTest, OnlyThePointsChange) {
  const fs::path original = shared_data / GetParam().path / "constant" / "polyMesh";
  const auto file = read_mesh_file(original);
  const auto mesh = file->mesh();
  EXPECT_EQ(mesh->point_count(), GetParam().points);
  EXPECT_EQ(mesh->face_count(), GetParam().faces);
  for (const auto& name : GetParam().groups) EXPECT_NE(mesh->find_group(name), nullptr) << name;
  EXPECT_EQ(file->with_points(mesh->points), read_file(original / "points.gz"));

  const fs::path folder =
      fs::path(testing::TempDir()) / ("shared_foam_" + std::to_string(::getpid())) / fs::path(GetParam().path).filename();
  fs::create_directories(folder / "constant");
  fs::create_directory_symlink(original, folder / "constant" / "polyMesh");
  const Points moved = deformed(mesh->points);
  write_mesh_file(*file, moved, folder / "1");
  const auto back = read_mesh_file(folder / "1")->mesh();
  EXPECT_EQ(back->points, moved);
  EXPECT_EQ(back->face_points, mesh->face_points);
  const auto changed = test::changed_words(read_file(original / "points.gz"), read_file(folder / "1" / "polyMesh" / "points"));
  EXPECT_EQ(changed.size(), 3 * mesh->point_count());
  fs::remove_all(folder.parent_path());
}

INSTANTIATE_TEST_SUITE_P(
    All, SharedFoamTest,
    testing::Values(SharedFile{"B_volume/openfoam/airFoil2D", 21812, 21812, {"walls", "frontAndBack"}},
                    SharedFile{
                        "B_volume/openfoam/car_fastback", 268807, 37399, {"inlet", "car_body", "car_wheel_rr", "carGroup"}},
                    SharedFile{"B_volume/openfoam/pipe_poly", 23446, 4296, {"outer", "inner"}},
                    SharedFile{"B_volume/openfoam/pipe_tet", 4353, 7398, {"volume"}}),
    [](const auto& tested) { return fs::path(tested.param.path).filename().string(); });

TEST(SharedDataFoldersTest, NoFileIsLeftOut) {
  std::vector<std::string> found, expected = {"C_defects/stl_empty_bin.stl"};
  for (const SharedFile& file : shared_files()) expected.emplace_back(file.path);
  for (const char* folder : {"A_surface", "B_volume/hex_medit", "B_volume/tet_medit", "C_defects"}) {
    for (const auto& entry : fs::directory_iterator(shared_data / folder)) {
      const std::string extension = entry.path().extension();
      if (extension != ".md" && extension != ".csv") found.push_back(folder + ("/" + entry.path().filename().string()));
    }
  }
  EXPECT_THAT(found, testing::UnorderedElementsAreArray(expected));
}

TEST(SharedDataFoldersTest, AnEmptyBinaryStlIsRefused) {
  test::expect_error(ErrorCode::invalid_argument, {"stl_empty_bin.stl", "byte 80", "0 triangles"},
                     [] { read_mesh_file(shared_data / "C_defects/stl_empty_bin.stl"); });
}

/// Numbers published with the meshes that need edges.
TEST(SharedDataInspectTest, AgreesWithTheProvenance) {
  const auto report_of = [](const char* path) { return inspect(*read_mesh_file(shared_data / path)->mesh()); };
  const MeshReport boeing = report_of("C_defects/boeing.off");
  EXPECT_EQ(boeing.components, 122U);
  EXPECT_EQ(boeing.boundary_edges, 2714U);
  EXPECT_EQ(boeing.coincident_points, 1477U);
  EXPECT_EQ(report_of("C_defects/blobby-shuffled.off").inconsistent_edges, 3069U);
  EXPECT_EQ(report_of("C_defects/cube-ouvert.off").isolated_points, 1U);
  EXPECT_EQ(report_of("C_defects/shared.STL").non_manifold_edges, 1U);
  EXPECT_EQ(report_of("C_defects/beetle.obj").non_manifold_edges, 47U);
  EXPECT_EQ(report_of("C_defects/beetle.obj").boundary_edges, 296U);
  EXPECT_EQ(report_of("C_defects/box.STL.gz").components, 10U);
  EXPECT_EQ(report_of("C_defects/truck.obj").components, 50U);
  EXPECT_EQ(report_of("A_surface/beetle.off").boundary_edges, 568U);
  EXPECT_EQ(report_of("A_surface/car_fastback.stl.gz").components, 5U);
  const MeshReport vase = report_of("A_surface/lion_vase_poly.off.gz");
  EXPECT_EQ(vase.triangles, 1U);
  EXPECT_EQ(vase.quads, 27U);
  EXPECT_EQ(vase.other_faces, 23077U);
  EXPECT_EQ(vase.boundary_edges, 0U);
  const MeshReport dragon = report_of("C_defects/dragon_res4.ply.gz");
  EXPECT_EQ(dragon.non_manifold_edges, 803U);
  EXPECT_EQ(dragon.isolated_points, 2U);
}

}  // namespace
}  // namespace deform::io::shared_data_test
