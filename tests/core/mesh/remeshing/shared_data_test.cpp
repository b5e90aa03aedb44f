// SPDX-License-Identifier: GPL-3.0-or-later
// Half-edges, remeshing and decimation of real meshes.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/io/mesh_file.h"
#include "core/mesh/remeshing/isotropic_remeshing.h"
#include "core/mesh/remeshing/triangles.h"
#include "tests/core/mesh/remeshing/decimation.h"
#include "tests/core/mesh/remeshing/remeshing_checks.h"

namespace deform::shared_data_test {
namespace {

/// All surfaces that can be read, by name.
template <typename Visit>
void for_each_mesh(const Visit& visit) {
  std::vector<std::filesystem::path> files;
  for (const char* folder : {"A_surface", "C_defects"}) {
    for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::path(DEFORM_SHARED_DATA) / folder)) {
      files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  for (const auto& file : files) {
    SCOPED_TRACE(file.filename().string());
    std::shared_ptr<const Mesh> mesh;
    try {
      mesh = io::read_mesh_file(file)->mesh();
    } catch (const Error&) {
      continue;  // no mesh, or a damaged one
    }
    visit(file.filename().string(), *mesh);
  }
}

TEST(SurfaceMeshShared, HoldsRealMeshesOrNamesWhatIsNotManifold) {
  std::size_t held = 0;
  for_each_mesh([&](const std::string&, const Mesh& input) {
    const MeshReport report = inspect(input);
    const auto short_faces =
        std::count_if(input.face_sizes.begin(), input.face_sizes.end(), [](std::uint32_t size) { return size < 3; });
    const std::size_t reasons = report.non_manifold_edges + report.inconsistent_edges + report.non_manifold_points +
                                static_cast<std::size_t>(short_faces);
    try {
      const SurfaceMesh mesh(input);
      mesh.check();
      ++held;
      EXPECT_EQ(reasons, 0u);
      EXPECT_EQ(mesh.edge_count(), report.edges);
      EXPECT_EQ(mesh.to_mesh().face_points, input.face_points);
    } catch (const Error& error) {
      EXPECT_GT(reasons, 0u) << error.what();
    }
  });
  EXPECT_GT(held, 20u);
}

struct Row {
  const char* name;
  std::size_t vertices;
  double features;  ///< degrees; 180: a rounded part, on which single edges above 45 degrees are noise
  double least;     ///< angle in degrees
  double farther;   ///< of the input from the result, in parts of the diagonal; edges that are not kept sharp are cut off
};

TEST(RemeshingShared, RealMeshes) {
  for (const Row& row : {Row{"fandisk.off.gz", 3000, 45, 15, 0.01}, Row{"joint_remeshed.off.gz", 5000, 45, 15, 0.01},
                         Row{"rocker-arm.obj.gz", 3000, 180, 15, 0.015}, Row{"pinion.off", 4000, 45, 15, 0.01}}) {
    SCOPED_TRACE(row.name);
    const Mesh input = *io::read_mesh_file(std::filesystem::path(DEFORM_SHARED_DATA) / "A_surface" / row.name)->mesh();
    const double diagonal = bounding_box(input.points).diagonal();
    const SurfaceMesh mesh(input);
    const SurfaceMesh made = isotropic_remeshing(mesh, {.vertices = row.vertices, .feature_degrees = row.features});
    test::expect_closed_like(input, made);
    test::expect_count(made, row.vertices);
    EXPECT_GE(least_angle(made), row.least);
    EXPECT_GT(mean_least_angle(made), 45);
    EXPECT_LT(test::farthest(made.to_mesh(), input), 1e-9 * diagonal);
    EXPECT_LT(test::farthest(input, made.to_mesh()), row.farther * diagonal);
    const SurfaceMesh fewer = decimated(mesh, input.point_count() / 10);
    test::expect_closed_like(input, fewer);
    EXPECT_EQ(fewer.vertex_count(), input.point_count() / 10);
    EXPECT_LT(test::farthest(input, fewer.to_mesh()), 0.02 * diagonal);
  }
}

}  // namespace
}  // namespace deform::shared_data_test
