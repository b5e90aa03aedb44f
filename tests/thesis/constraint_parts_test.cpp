// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 8.6.1, figures 8.8 and 8.9: constraints found on the fandisk and the joint stay in a deformation.
#include <gtest/gtest.h>

#include <string>

#include "tests/bench/constraint_parts.h"
#include "tests/support/thesis_options.h"

namespace deform::constraint_parts_test {
namespace {

using bench::ConstraintCase;
using bench::Exactness;
using bench::Outcome;

/// Residuals at most 1e-2 of those without constraints, and handles and fixed points where they were told to be.
void expect_kept(const ConstraintCase& of, const decltype(deform::Setup::method)& method) {
  const deform::Setup setup = bench::with_method(of, method, 0, Exactness::on);
  const Outcome outcome = bench::solved(*prepare(of.mesh, setup), of.design);
  EXPECT_TRUE(outcome.report.converged);
  for (std::size_t c = 0; c < outcome.report.constraints.size(); ++c) {
    const ConstraintReport& report = outcome.report.constraints[c];
    const std::string& name = setup.constraints[c].name;
    EXPECT_LE(report.rms, 1e-2 * report.rms_before) << of.name << ": " << name;
    EXPECT_NEAR(bench::misfit(setup.constraints[c], *of.mesh, outcome.points).rms, report.rms, 1e-6) << name;
    testing::Test::RecordProperty(name, std::to_string(report.rms / report.rms_before));
  }
  const double tolerance = 1e-9 * bounding_box(of.mesh->points).diagonal();
  const SelectedRegions regions = validate(setup, *of.mesh);
  const auto expect_at = [&](PointId id, const Vec3& place) {
    for (std::size_t k = 0; k < 3; ++k) ASSERT_NEAR(outcome.points[id][k], place[k], tolerance) << id;
  };
  const Affine& motion = std::get<Affine>(of.design.motions[0].value);
  for (const PointId id : regions.fixed) expect_at(id, of.mesh->points[id]);
  for (const PointId id : regions.handles[0]) expect_at(id, transformed(motion, of.mesh->points[id]));
}

TEST(DetectedParts, TheBoreOfTheJointStaysRound) {
  const ConstraintCase joint = bench::joint_case(DEFORM_SHARED_DATA);
  ASSERT_EQ(joint.setup.constraints.size(), 2u);
  expect_kept(joint, ShellOptions{});
  MlsOptions options = test::thesis_mls();
  options.surface_samples = 1500;
  expect_kept(joint, options);
}

TEST(DetectedParts, FeatureLinesAndAPlaneOfTheFandisk) {
  const ConstraintCase fandisk = bench::fandisk_case(DEFORM_SHARED_DATA);
  ASSERT_GE(fandisk.setup.constraints.size(), 3u);
  expect_kept(fandisk, ShellOptions{});
  MlsOptions options = test::thesis_mls();
  options.surface_samples = 1500;
  expect_kept(fandisk, options);
}

}  // namespace
}  // namespace deform::constraint_parts_test
