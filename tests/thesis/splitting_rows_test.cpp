// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 7.4, figure 7.9: a large motion in one step inverts cells, the same in n <= 20 equal steps does not; n, the least
// determinant of every step and the factorizations are reported, and so is that no n up to the cap is enough.
#include <gtest/gtest.h>

#include "core/deformers/splitting.h"
#include "core/quality/element_quality.h"
#include "core/quality/polyhedral_quality.h"
#include "tests/core/deformers/block_meshes.h"
#include "tests/core/quality/cell_shapes.h"

namespace deform::splitting_rows_test {
namespace {

using test::block_setup;
using test::moved_block;

SplitProblem problem_of(Mesh mesh, int dimensions) {
  SplitProblem problem;
  problem.mesh = test::shared(std::move(mesh));
  problem.setup = block_setup(dimensions);
  problem.cells = problem.mesh.get();
  return problem;
}

/// One step inverts, some number of equal steps up to 20 does not, and all of it is told.
SplitResult expect_saved(const SplitProblem& problem, const Design& design) {
  const SplitResult result = evaluate_split(problem, design);
  EXPECT_GT(result.full_step.inverted.count, 0u);
  EXPECT_LT(result.full_step.inverted.least_determinant.value, 0);
  EXPECT_LT(result.full_step.amplitude, 1);
  EXPECT_TRUE(result.inversion_free);
  EXPECT_GE(result.steps, 2u);
  EXPECT_LE(result.steps, 20u);
  EXPECT_EQ(result.reached, 1);
  EXPECT_EQ(result.substeps.size(), result.steps);
  for (const Substep& substep : result.substeps) EXPECT_GT(substep.least_determinant.value, 0);
  EXPECT_EQ(result.attempts.size(), result.steps);
  EXPECT_EQ(result.reused, result.steps);
  EXPECT_GE(result.factorizations, result.steps);
  EXPECT_LE(result.factorizations, 1 + result.steps * (result.steps - 1) / 2);
  const Points ordinary = prepare(problem.mesh, problem.setup)->evaluate(design);
  const SelectedRegions regions = validate(problem.setup, *problem.mesh);
  for (const PointId id : regions.handles[0]) EXPECT_EQ(result.points[id], ordinary[id]);
  for (const PointId id : regions.fixed) EXPECT_EQ(result.points[id], problem.mesh->points[id]);
  return result;
}

TEST(Splitting, BlockInASquare) {
  const SplitProblem problem = problem_of(test::square(30), 2);
  const SplitResult turned = expect_saved(problem, moved_block(2.3, {}));
  EXPECT_EQ(turned.steps, 2u);
  EXPECT_GT(turned.full_step.inverted.count, 100u);
  const SplitResult shifted = expect_saved(problem, moved_block(0, {0.28, 0.28, 0}));
  EXPECT_EQ(shifted.steps, 3u);
  for (const Vec3& p : turned.points) EXPECT_EQ(p[2], 0);
}

TEST(Splitting, BlockInACubeOfHexahedra) {
  const test::Cube cube = test::cube(10);
  SplitProblem problem = problem_of(cube.mesh, 3);
  problem.cells = &cube.elements;
  for (const Design& design : {moved_block(1.7, {}), moved_block(0, {0.17, 0.17, 0.17})}) {
    const SplitResult result = expect_saved(problem, design);
    const ElementQuality quality = element_quality(result.points, cube.elements);
    EXPECT_EQ(quality.inverted_elements, 0u);
    EXPECT_EQ(quality.least_scaled_jacobian.value, result.substeps.back().least_determinant.value);
    EXPECT_GT(element_quality(prepare(problem.mesh, problem.setup)->evaluate(design), cube.elements).inverted_elements, 0u);
  }
}

/// Six tetrahedra of every hexahedron, around its diagonal.
Elements tetrahedra_of(const Elements& hexahedra) {
  Elements result;
  constexpr std::size_t around[] = {1, 2, 3, 7, 4, 5};
  for (std::size_t e = 0; e < hexahedra.size(); ++e) {
    const auto nodes = hexahedra.nodes(e);
    for (std::size_t k = 0; k < 6; ++k) {
      const PointId tetrahedron[] = {nodes[0], nodes[around[k]], nodes[around[(k + 1) % 6]], nodes[6]};
      result.add(ElementType::tetrahedron, tetrahedron);
    }
  }
  return result;
}

TEST(Splitting, BlockInACubeOfTetrahedra) {
  const test::Cube cube = test::cube(10);
  const Elements tetrahedra = tetrahedra_of(cube.elements);
  SplitProblem problem = problem_of(cube.mesh, 3);
  problem.cells = &tetrahedra;
  const SplitResult result = expect_saved(problem, moved_block(1.6, {}));
  EXPECT_EQ(element_quality(result.points, tetrahedra).inverted_elements, 0u);
}

TEST(Splitting, BlockInACubeOfPolyhedra) {
  constexpr std::uint32_t n = 10;
  test::Grid grid = test::grid(n, n, n);
  for (Vec3& p : grid.points) {
    for (double& x : p) x /= n;
  }
  SplitProblem problem = problem_of(test::cube(n).mesh, 3);
  ASSERT_LT(test::distance(problem.mesh->points, grid.points), 1e-15);
  problem.cells = &grid.cells;
  const SplitResult result = expect_saved(problem, moved_block(2.0, {}));
  const PolyhedralQuality quality = polyhedral_quality(result.points, grid.cells);
  EXPECT_EQ(quality.wrong_pyramids, 0u);
  EXPECT_EQ(quality.inverted_cells, 0u);
}

// The cells at the block are too coarse for this turn in any number of steps: it is said so, and how far the mesh got.
TEST(Splitting, FailsHonestlyAtTheCap) {
  const SplitProblem problem = problem_of(test::square(20), 2);
  const SplitResult result = evaluate_split(problem, moved_block(2.7, {}));
  EXPECT_FALSE(result.inversion_free);
  EXPECT_EQ(result.steps, 20u);
  ASSERT_EQ(result.attempts.size(), 20u);
  std::size_t factorizations = 1;
  for (std::size_t k = 0; k < 20; ++k) {
    EXPECT_EQ(result.attempts[k].steps, k + 1);
    EXPECT_LT(result.attempts[k].completed, k + 1);
    EXPECT_GT(result.attempts[k].inverted, 0u);
    EXPECT_LE(result.attempts[k].least_determinant, 0);
    factorizations += result.attempts[k].completed;
  }
  EXPECT_EQ(result.factorizations, factorizations + 1) << "and one to go on from the farthest place";
  EXPECT_GT(result.reached, 0.5);
  EXPECT_LT(result.reached, 1);
  EXPECT_EQ(InversionCheck(problem.mesh->points, problem.cells).inverted(result.points).count, 0u);
}

}  // namespace
}  // namespace deform::splitting_rows_test
