// SPDX-License-Identifier: GPL-3.0-or-later
// What symmetry planes do for the cells at them.
#include <gtest/gtest.h>

#include <cmath>

#include "core/deformers/splitting.h"
#include "core/quality/safe_amplitude.h"
#include "tests/core/deformers/block_meshes.h"

namespace deform::symmetry_mesh_test {
namespace {

// Half of a channel [0, 1]^3, cut at y = 0, and half of a block in it that the cut goes through.
struct Channel {
  test::Cube cube = test::cube(10);
  std::shared_ptr<const Mesh> mesh = test::shared(cube.mesh);
  deform::Setup setup;

  Channel() {
    setup.handles = {{"block", test::box({0.399, -0.001, 0.399}, {0.601, 0.201, 0.601})}};
    for (const int axis : {0, 2}) {
      for (const double at : {0.0, 1.0}) setup.fixed.push_back(side(axis, at));
    }
    setup.fixed.push_back(side(1, 1));
  }

  static Region side(std::size_t axis, double at) {
    Vec3 min{-1, -1, -1}, max{2, 2, 2};
    min[axis] = at - 1e-9;
    max[axis] = at + 1e-9;
    return test::box(min, max);
  }

  std::vector<PointId> cut() const { return select(side(1, 0), *mesh, "cut"); }

  Inversions inverted(const Points& points) const {
    return InversionCheck(mesh->points, CellSet{&cube.elements}).inverted(points);
  }
};

/// Along x, and thicker by a factor.
Design moved(double shift, double scale) { return {{}, {{0, Affine{1, 0, 0, shift, 0, scale, 0, 0, 0, 0, 1, 0}}}}; }

TEST(SymmetryMesh, CellsAtThePlaneSurvive) {
  Channel channel;
  const Design design = moved(0.15, 1.5);
  const auto leaves = [&](const Points& points) {
    double largest = 0;
    for (const PointId id : channel.cut()) largest = std::max(largest, std::abs(points[id][1]));
    return largest;
  };
  const Points free = prepare(channel.mesh, channel.setup)->evaluate(design);
  EXPECT_GT(leaves(free), 0.002);

  deform::Setup held = channel.setup;
  const Region block = held.handles[0].region;
  held.fixed.push_back({Region::Difference{{Channel::side(1, 0), block}}});
  for (std::size_t i = 0; i + 1 < held.fixed.size(); ++i) held.fixed[i] = {Region::Difference{{held.fixed[i], block}}};
  const Points fixed = prepare(channel.mesh, held)->evaluate(design);
  EXPECT_EQ(leaves(fixed), 0);
  EXPECT_GT(channel.inverted(fixed).count, 0u);

  deform::Setup symmetric = channel.setup;
  symmetric.symmetry = {{SymmetryPlane::Plane{{0, 0, 0}, {0, 1, 0}}}};
  const Points slid = prepare(channel.mesh, symmetric)->evaluate(design);
  EXPECT_EQ(leaves(slid), 0);
  EXPECT_EQ(channel.inverted(slid).count, 0u) << channel.inverted(slid).least_determinant.value;
}

TEST(SymmetryMesh, SplittingKeepsThePlane) {
  Channel channel;
  for (const SplitMode mode : {SplitMode::uniform, SplitMode::adaptive}) {
    SplitProblem problem;
    problem.mesh = channel.mesh;
    problem.setup = channel.setup;
    problem.setup.symmetry = {{Channel::side(1, 0)}};
    problem.cells = CellSet{&channel.cube.elements};
    const SplitResult result = evaluate_split(problem, moved(0.3, 1.5), {mode, 20, 0.5});
    EXPECT_TRUE(result.inversion_free);
    EXPECT_GT(result.factorizations, 1u);
    for (const PointId id : channel.cut()) EXPECT_NEAR(result.points[id][1], 0, 1e-14);
  }
}

}  // namespace
}  // namespace deform::symmetry_mesh_test
