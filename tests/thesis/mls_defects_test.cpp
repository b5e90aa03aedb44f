// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 8.4 on real meshes: many components, holes, degenerate and non-manifold faces, soups, volumes. Nothing is asked of the
// faces.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "core/deformers/energy/spaces/mls.h"
#include "core/io/mesh_file.h"
#include "tests/core/deformers/space_cases.h"
#include "tests/support/thesis_options.h"

namespace deform::mls_defects_test {
namespace {

using Eigen::VectorXd;

/// The lower tenth of the longest extent stays, the upper tenth moves by 1. What lies between moves by 0 to 1, and all of it does
/// when both ends move.
class Defects : public testing::TestWithParam<const char*> {};

TEST_P(Defects, MoveSmoothlyWhateverTheFacesAre) {
  const Mesh mesh = *io::read_mesh_file(std::filesystem::path(DEFORM_SHARED_DATA) / GetParam())->mesh();
  const Box box = bounding_box(mesh.points);
  std::size_t axis = 0;
  for (std::size_t k = 1; k < 3; ++k) axis = box.max[k] - box.min[k] > box.max[axis] - box.min[axis] ? k : axis;
  const double length = box.max[axis] - box.min[axis];
  std::vector<PointId> held;
  std::vector<double> one_end;
  for (PointId i = 0; i < mesh.points.size(); ++i) {
    const double at = (mesh.points[i][axis] - box.min[axis]) / length;
    if (at > 0.1 && at < 0.9) continue;
    held.push_back(i);
    one_end.push_back(at > 0.5 ? 1 : 0);
  }
  MlsOptions options = test::thesis_mls();
  options.stretching = 1;
  options.bending = 0.1;
  options.surface_samples = 600;
  if (mesh.cell_count() != 0) options.volume_samples = 300;
  const EnergySpace space = mls_space(mesh, options, 1);
  EXPECT_LE(space.samples, 900u);
  EXPECT_LT(space.values.nonZeros(), static_cast<std::int64_t>(200 * mesh.points.size()));
  const Eigen::Map<const VectorXd> lifted(one_end.data(), static_cast<Eigen::Index>(one_end.size()));
  const VectorXd moved = test::least_energy(space, held, lifted);
  std::printf("%s: %zu points, %zu samples, %.1f functions a point, %.3f .. %.3f\n", GetParam(), mesh.points.size(),
              space.samples, static_cast<double>(space.values.nonZeros()) / static_cast<double>(mesh.points.size()),
              moved.minCoeff(), moved.maxCoeff());
  for (const std::string& note : space.notes) std::printf("  %s\n", note.c_str());
  EXPECT_GE(moved.minCoeff(), -0.03);
  EXPECT_LE(moved.maxCoeff(), 1.03);
  const VectorXd shifted = test::least_energy(space, held, VectorXd::Constant(lifted.size(), 1));
  EXPECT_LT((shifted.array() - 1).abs().maxCoeff(), 1e-3);
}

INSTANTIATE_TEST_SUITE_P(Files, Defects,
                         testing::Values("A_surface/beetle.off", "A_surface/fandisk_quads.off", "A_surface/joint.off",
                                         "C_defects/boeing.off", "C_defects/soup.stl", "C_defects/motor.stl.gz",
                                         "C_defects/degtri_sliding.off", "C_defects/mech-holes-shark.off.gz",
                                         "C_defects/truck.obj", "C_defects/wallhole.obj", "C_defects/chair_model.obj.gz",
                                         "C_defects/tetra_intersected_by_triangle.off", "C_defects/sparger.stl.gz",
                                         "C_defects/mpi.off"),
                         [](const auto& tested) {
                           std::string name = std::filesystem::path(tested.param).stem().stem().string();
                           std::replace_if(
                               name.begin(), name.end(), [](char c) { return std::isalnum(c) == 0; }, '_');
                           return name;
                         });

}  // namespace
}  // namespace deform::mls_defects_test
