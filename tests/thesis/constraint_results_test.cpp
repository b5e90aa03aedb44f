// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 8.6 and 8.6.3: what does not depend on how many points a set has, and rigid columns of cells on a wall.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/mesh/wall_columns.h"
#include "core/quality/element_quality.h"
#include "tests/bench/constraint_cases.h"
#include "tests/support/thesis_options.h"

namespace deform::constraint_results_test {
namespace {

using bench::ConstraintCase;
using bench::Outcome;

MlsOptions few_samples() {
  MlsOptions options = test::thesis_mls();
  options.surface_samples = 600;
  return options;
}

/// Every other point of a region of ids: on these grids, with rows of an odd number of points, like the fields of a chessboard.
Region every_other(const Region& region) {
  Region::Ids ids;
  for (const PointId id : std::get<Region::Ids>(region.kind).ids) {
    if (id % 2 == 0) ids.ids.push_back(id);
  }
  return {std::move(ids)};
}

/// Largest difference over the largest displacement.
double change(const ConstraintCase& of, const Points& a, const Points& b) {
  double difference = 0, moved = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Vec3& x = of.mesh->points[i];
    difference = std::max(difference, std::hypot(a[i][0] - b[i][0], a[i][1] - b[i][1], a[i][2] - b[i][2]));
    moved = std::max(moved, std::hypot(a[i][0] - x[0], a[i][1] - x[1], a[i][2] - x[2]));
  }
  return difference / moved;
}

class NormalizedWeights : public testing::TestWithParam<const char*> {
 protected:
  static ConstraintCase find(const std::string& name) {
    const std::vector<ConstraintCase> cases = bench::constraint_cases(40);
    return *std::find_if(cases.begin(), cases.end(), [&](const ConstraintCase& c) { return c.name == name; });
  }
};

TEST_P(NormalizedWeights, TwiceAsManyConstrainedPointsChangeLittle) {
  ConstraintCase of = find(GetParam());
  const Outcome all = bench::solved(*prepare(of.mesh, bench::with_method(of, few_samples())), of.design);
  for (Region& region : of.setup.constraints[0].regions) region = every_other(region);
  const Outcome half = bench::solved(*prepare(of.mesh, bench::with_method(of, few_samples())), of.design);
  EXPECT_TRUE(all.report.converged);
  EXPECT_TRUE(half.report.converged);
  EXPECT_GT(all.report.constraints[0].rms_before, 1e-3);
  const double changed = change(of, all.points, half.points);
  RecordProperty("change", std::to_string(changed));
  EXPECT_LT(changed, 0.01);
}

INSTANTIATE_TEST_SUITE_P(Kinds, NormalizedWeights, testing::Values("planar", "circular", "cylindrical", "feature_line", "rigid"),
                         [](const auto& tested) { return std::string(tested.param); });

class NormalizedHandleWeights : public testing::TestWithParam<HandleMode> {};

TEST_P(NormalizedHandleWeights, TwiceAsManyHandlePointsChangeLittle) {
  ConstraintCase of = bench::constraint_cases(40)[0];
  of.setup.constraints.clear();
  MlsOptions options = few_samples();
  options.handles = GetParam();
  const Outcome all = bench::solved(*prepare(of.mesh, bench::with_method(of, options)), of.design);
  of.setup.handles[0].region = every_other(of.setup.handles[0].region);
  of.setup.fixed[0] = every_other(of.setup.fixed[0]);
  const Outcome half = bench::solved(*prepare(of.mesh, bench::with_method(of, options)), of.design);
  const double changed = change(of, all.points, half.points);
  RecordProperty("change", std::to_string(changed));
  EXPECT_LT(changed, 0.01);
}

INSTANTIATE_TEST_SUITE_P(Modes, NormalizedHandleWeights, testing::Values(HandleMode::hard, HandleMode::soft),
                         [](const auto& tested) { return tested.param == HandleMode::hard ? "hard" : "soft"; });

TEST(RigidLayers, RigidColumnsKeepTheShapeOfThinCells) {
  const ConstraintCase block = bench::prism_block();
  const WallColumns columns = wall_columns(*block.mesh, select(block.setup.constraints[0].regions[0], *block.mesh, "columns"), 4);
  EXPECT_EQ(columns.points.size(), 80u);
  EXPECT_EQ(columns.shorter, 0u);
  MlsOptions options = test::thesis_mls();
  options.surface_samples = 400;
  options.volume_samples = 300;
  deform::Setup without = bench::with_method(block, options);
  without.constraints.clear();
  const Outcome loose = bench::solved(*prepare(block.mesh, without), block.design);
  const Outcome soft = bench::solved(*prepare(block.mesh, bench::with_method(block, options)), block.design);
  const Outcome rigid =
      bench::solved(*prepare(block.mesh, bench::with_method(block, options, 0, bench::Exactness::on)), block.design);
  EXPECT_TRUE(soft.report.converged);
  EXPECT_TRUE(rigid.report.converged);
  const bench::ShapeChange before = bench::shape_change(columns.points, block.mesh->points, loose.points);
  const bench::ShapeChange after = bench::shape_change(columns.points, block.mesh->points, rigid.points);
  RecordProperty("without", std::to_string(before.largest));
  RecordProperty("with", std::to_string(after.largest));
  EXPECT_GT(before.largest, 1e-2);
  EXPECT_LE(bench::shape_change(columns.points, block.mesh->points, soft.points).largest, 2e-3) << "weighted only";
  // Exact columns contradict the points of the wall that are held, and keep their soft fit where they would move points too far.
  EXPECT_LE(after.largest, 1.1e-3);
  for (const Outcome* outcome : {&loose, &soft, &rigid}) {
    EXPECT_EQ(element_quality(outcome->points, *block.mesh->elements).inverted_elements, 0u);
  }
}

}  // namespace
}  // namespace deform::constraint_results_test
