// SPDX-License-Identifier: GPL-3.0-or-later
// Cages of real meshes: closed ones with and without handles, open ones, soups, a case of OpenFOAM.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <iostream>
#include <string>

#include "core/io/mesh_file.h"
#include "core/mesh/cages/cage_around.h"
#include "core/mesh/cages/crossing_triangles.h"
#include "tests/core/mesh/cages/cage_checks.h"

namespace deform::shared_data_test {
namespace {

struct Row {
  const char* file;
  int genus;                 ///< of the object, and so of the wrap; -1: not closed or not manifold, so that it has none
  std::size_t points = 400;  ///< of the cage; its handles have to be wider than twice the offset that these take
};

class CageOf : public testing::TestWithParam<Row> {};

TEST_P(CageOf, ARealMesh) {
  const auto mesh = io::read_mesh_file(std::filesystem::path(DEFORM_SHARED_DATA) / GetParam().file)->mesh();
  const MeshReport object = inspect(*mesh);
  const bool closed = object.boundary_edges + object.non_manifold_edges + object.non_manifold_points == 0;
  if (closed && object.components == 1 && GetParam().genus >= 0) {
    const std::size_t used = object.points - object.isolated_points, handles = static_cast<std::size_t>(GetParam().genus);
    EXPECT_EQ(used + object.faces + 2 * handles, object.edges + 2);
  }
  for (const CageKind kind : {CageKind::box, CageKind::hull, CageKind::wrap}) {
    SCOPED_TRACE(static_cast<int>(kind));
    const auto start = std::chrono::steady_clock::now();
    const CageAround cage = cage_around(*mesh, {.kind = kind, .points = GetParam().points});
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    test::expect_cage(cage, *mesh, GetParam().points);
    EXPECT_EQ(crossing_triangles(cage.mesh), 0u);
    EXPECT_LT(seconds, 60) << "10 on a machine that does nothing else";
    const int genus = kind == CageKind::wrap ? GetParam().genus : 0;
    if (genus >= 0) {
      EXPECT_EQ(cage.genus, static_cast<std::size_t>(genus));
    }
    std::cout << GetParam().file << " kind " << static_cast<int>(kind) << ": " << mesh->point_count() << " points, cage "
              << cage.mesh.point_count() << ", offset " << cage.offset / bounding_box(mesh->points).diagonal() << " D after "
              << cage.attempts << ", angle " << cage.least_angle << ", genus " << cage.genus << ", components " << cage.components
              << ", " << seconds << " s\n";
  }
}

INSTANTIATE_TEST_SUITE_P(Shared, CageOf,
                         testing::Values(Row{"A_surface/joint.off", 2, 800}, Row{"A_surface/fandisk.off.gz", 0},
                                         Row{"A_surface/rocker-arm.obj.gz", 1}, Row{"A_surface/car_fastback.stl.gz", -1},
                                         Row{"A_surface/beetle.off", -1}, Row{"A_surface/DTC-scaled.stl.gz", -1},
                                         Row{"A_surface/oneraM6_wing.off.gz", -1}, Row{"A_surface/bumpy-cube.obj.gz", 0},
                                         Row{"A_surface/plane.off", -1}, Row{"A_surface/propellerTip.obj.gz", -1},
                                         Row{"A_surface/pipe.off", 1}, Row{"C_defects/soup.stl", -1},
                                         Row{"C_defects/truck.obj", -1}, Row{"C_defects/mech-holes-shark.off.gz", -1},
                                         Row{"B_volume/param/bore_tet_p0.e", 1}),
                         [](const auto& info) {
                           // The file without folder and extension, as a name of C++.
                           std::string name = std::filesystem::path(info.param.file).filename().string();
                           name = name.substr(0, name.find('.'));
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

// Cut a little off the plane, so that both halves end beside it in walls that are closer to each other than the edges are long.
TEST(HalfCage, OfARealMeshCanBeCutInThePlane) {
  Mesh spool = *io::read_mesh_file(std::filesystem::path(DEFORM_SHARED_DATA) / "A_surface/spool.off")->mesh();
  for (Vec3& x : spool.points) x = {x[1], -x[0], x[2]};
  const Mesh half = test::part_above(spool, 0, 0);
  for (const double offset : {0.038, 0.0475, 0.0593}) {
    for (const std::size_t vertices : {200u, 400u, 800u}) test::expect_cut(half, offset, vertices);
  }
}

}  // namespace
}  // namespace deform::shared_data_test
