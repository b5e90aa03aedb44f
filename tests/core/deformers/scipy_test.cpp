// SPDX-License-Identifier: GPL-3.0-or-later
// The interpolant against scipy.interpolate.RBFInterpolator (kernel cubic, degree 1): 1e-9 relative.
#include <gtest/gtest.h>

#include "core/deformers/rbf/rbf_system.h"
#include "core/mesh/ahmed.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/scipy_interpolator.h"

namespace deform::scipy_test {
namespace {

TEST(SciPy, AgreesOnBothPaths) {
  AhmedOptions body;
  body.target_points = 4000;
  const auto mesh = test::shared(ahmed_body(body));
  deform::Setup setup;
  setup.handles = {{"slant", {Region::GroupName{"slant"}}}};
  setup.fixed = {{Region::GroupName{"nose"}}, {Region::GroupName{"stilts"}}};
  RbfOptions options;
  options.reduction = CentreReduction::off;
  setup.method = options;
  const auto system = prepare(mesh, setup);
  Design design;
  design.motions = {{0, test::turn_and_shift()}};

  const SelectedRegions regions = validate(setup, *mesh);
  Points centres, displacements;
  for (const PointId id : regions.handles[0]) {
    const Vec3& x = mesh->points[id];
    const Vec3 to = transformed(test::turn_and_shift(), x);
    centres.push_back(x);
    displacements.push_back({to[0] - x[0], to[1] - x[1], to[2] - x[2]});
  }
  for (const PointId id : regions.fixed) {
    centres.push_back(mesh->points[id]);
    displacements.push_back({0, 0, 0});
  }
  const test::SciPyResult scipy =
      test::interpolate_with_scipy(DEFORM_PYTHON, DEFORM_SCIPY_SCRIPT, centres, displacements, mesh->points);
  ASSERT_EQ(scipy.error, "");
  double size = 0;
  for (const Vec3& u : scipy.values) size = std::max(size, test::distance(u, {0, 0, 0}));
  ASSERT_GT(size, 0.1);
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    Points ours = system->evaluate({&design, 1}, path)[0];
    for (std::size_t i = 0; i < ours.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) ours[i][k] -= mesh->points[i][k];
    }
    EXPECT_LT(test::distance(ours, scipy.values), 1e-9 * size);
  }
}

}  // namespace
}  // namespace deform::scipy_test
