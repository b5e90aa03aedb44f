// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 3.5, figure 3.9: the biharmonic kernel leaves a kink at the centres, the triharmonic one is C2.
#include <gtest/gtest.h>

#include <cmath>

#include "core/deformers/rbf/rbf_system.h"
#include "tests/core/deformers/shapes.h"

namespace deform::kernel_smoothness_test {
namespace {

// A flat sheet lifted at one point and held at its rim; the mean curvature there by second differences of step h: 1/2 (z_xx +
// z_yy) at a point where the surface is level.
double curvature_at_the_handle(Kernel kernel, double h) {
  Mesh mesh;
  for (int j = 0; j <= 10; ++j) {
    for (int i = 0; i <= 10; ++i) mesh.points.push_back({0.1 * i, 0.1 * j, 0});
  }
  const auto first = static_cast<PointId>(mesh.points.size());
  for (const Vec3& d : {Vec3{h, 0, 0}, Vec3{-h, 0, 0}, Vec3{0, h, 0}, Vec3{0, -h, 0}}) {
    mesh.points.push_back({0.5 + d[0], 0.5 + d[1], 0});
  }
  deform::Setup setup;
  RbfOptions options;
  options.kernel = kernel;
  setup.method = options;
  setup.handles = {{"middle", {Region::Ids{{60}}}}};
  Region::Ids rim;
  for (PointId id = 0; id < 121; ++id) {
    if (id % 11 == 0 || id % 11 == 10 || id < 11 || id >= 110) rim.ids.push_back(id);
  }
  setup.fixed = {{rim}};
  Design design;
  design.motions = {{0, Affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.2}}};
  const Points got = prepare(test::shared(mesh), setup)->evaluate(design);
  double sum = 0;
  for (PointId k = 0; k < 4; ++k) sum += got[first + k][2];
  return std::abs(sum - 4 * got[60][2]) / (2 * h * h);
}

TEST(KernelSmoothness, BiharmonicCurvatureDivergesTriharmonicConverges) {
  double biharmonic = curvature_at_the_handle(Kernel::biharmonic, 0.02);
  double triharmonic = curvature_at_the_handle(Kernel::triharmonic, 0.02);
  double change = HUGE_VAL;
  for (const double h : {0.005, 0.00125}) {  // four times finer, twice
    const double rough = curvature_at_the_handle(Kernel::biharmonic, h);
    EXPECT_GT(rough, 3.5 * biharmonic);  // like 1 / h
    biharmonic = rough;
    const double smooth = curvature_at_the_handle(Kernel::triharmonic, h);
    EXPECT_LT(std::abs(smooth - triharmonic), 0.3 * change);  // like h
    EXPECT_LT(std::abs(smooth - triharmonic), 0.2 * smooth);
    change = std::abs(smooth - triharmonic);
    triharmonic = smooth;
  }
}

}  // namespace
}  // namespace deform::kernel_smoothness_test
