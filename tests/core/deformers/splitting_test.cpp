// SPDX-License-Identifier: GPL-3.0-or-later
// Splitting: what a step starts from and ends at, what is counted, how it fails, what it refuses. That it helps is tested in
// tests/thesis/splitting_rows_test.cpp.
#include "core/deformers/splitting.h"

#include <gtest/gtest.h>

#include <mutex>
#include <set>

#include "tests/core/deformers/block_meshes.h"
#include "tests/support/expect_error.h"

namespace deform {
namespace {

using test::block_setup;
using test::moved_block;

SplitProblem square_problem(std::size_t n) {
  SplitProblem problem;
  problem.mesh = test::shared(test::square(n));
  problem.setup = block_setup(2);
  problem.cells = problem.mesh.get();
  return problem;
}

void expect_prescribed(const SplitResult& result, const SplitProblem& problem, const Design& design) {
  const Points ordinary = prepare(problem.mesh, problem.setup)->evaluate(design);
  const SelectedRegions regions = validate(problem.setup, *problem.mesh);
  for (const PointId id : regions.handles[0]) EXPECT_EQ(result.points[id], ordinary[id]);
  for (const PointId id : regions.fixed) EXPECT_EQ(result.points[id], problem.mesh->points[id]);
}

TEST(Splitting, OneStepIsTheOrdinaryEvaluation) {
  const SplitProblem problem = square_problem(20);
  const Design affine = moved_block(0.5, {0.05, 0, 0});
  Design free = affine;
  const std::size_t count = validate(problem.setup, *problem.mesh).handles[0].size();
  free.motions[0].value = std::vector<Vec3>(count, Vec3{0.03, 0.1, 0});
  for (const Design& design : {affine, free}) {
    for (const SplitMode mode : {SplitMode::uniform, SplitMode::adaptive}) {
      SplitOptions options;
      options.mode = mode;
      const SplitResult result = evaluate_split(problem, design, options);
      EXPECT_TRUE(result.inversion_free);
      EXPECT_TRUE(result.points == prepare(problem.mesh, problem.setup)->evaluate(design));
      EXPECT_EQ(result.steps, 1u);
      EXPECT_EQ(result.reached, 1);
      EXPECT_EQ(result.factorizations, 1u);
      EXPECT_EQ(result.reused, 1u);
      ASSERT_EQ(result.substeps.size(), 1u);
      EXPECT_EQ(result.substeps[0].amplitude, 1);
      EXPECT_EQ(result.substeps[0].least_determinant.value, result.full_step.inverted.least_determinant.value);
      EXPECT_EQ(result.attempts.size(), 1u);
    }
  }
}

TEST(Splitting, UsesTheSystemAtHand) {
  SplitProblem problem = square_problem(30);
  const Design design = moved_block(2.3, {});
  const SplitResult own = evaluate_split(problem, design);
  problem.system = prepare(problem.mesh, problem.setup);
  const SplitResult lent = evaluate_split(problem, design);
  EXPECT_EQ(lent.factorizations + 1, own.factorizations);
  EXPECT_TRUE(lent.points == own.points);
}

// Step by step by hand: regions stay the points they were, every system is prepared where the step before ended.
TEST(Splitting, StepsAreThoseOfTheThesis) {
  const SplitProblem problem = square_problem(30);
  const Design design = moved_block(2.3, {});
  const SplitResult result = evaluate_split(problem, design);
  ASSERT_TRUE(result.inversion_free);
  ASSERT_EQ(result.steps, 3u);
  const Points& rest = problem.mesh->points;
  const Points full = prepare(problem.mesh, problem.setup)->evaluate(design);
  const SelectedRegions regions = validate(problem.setup, *problem.mesh);
  Points at = rest;
  for (int k = 1; k <= 3; ++k) {
    auto moved = std::make_shared<Mesh>(*problem.mesh);
    moved->points = at;
    deform::Setup setup;
    setup.handles = {{"block", {Region::Ids{regions.handles[0]}}}};
    setup.fixed = {{Region::Ids{regions.fixed}}};
    std::vector<Vec3> displacements;
    for (const PointId id : regions.handles[0]) {
      Vec3& u = displacements.emplace_back();
      for (std::size_t c = 0; c < 3; ++c) u[c] = rest[id][c] + k / 3.0 * (full[id][c] - rest[id][c]) - at[id][c];
    }
    at = prepare(moved, setup)->evaluate({{}, {{0, displacements}}});
  }
  EXPECT_LT(test::distance(at, result.points), 1e-10);
  expect_prescribed(result, problem, design);
}

TEST(Splitting, CountsWhatItDid) {
  const SplitProblem problem = square_problem(30);
  const SplitResult result = evaluate_split(problem, moved_block(2.3, {}));
  ASSERT_EQ(result.attempts.size(), 3u);
  std::size_t factorizations = 1;
  for (std::size_t k = 0; k < 3; ++k) {
    const SplitAttempt& attempt = result.attempts[k];
    EXPECT_EQ(attempt.steps, k + 1);
    EXPECT_TRUE(attempt.failure.empty());
    EXPECT_EQ(attempt.inverted == 0, attempt.least_determinant > 0);
    if (k < 2) {
      EXPECT_LT(attempt.completed, attempt.steps);
      EXPECT_GT(attempt.inverted, 0u);
      factorizations += attempt.completed;  // the step that failed had one, too, but the first none
    }
  }
  EXPECT_EQ(result.attempts[2].completed, 3u);
  EXPECT_EQ(result.attempts[0].inverted, result.full_step.inverted.count);
  EXPECT_EQ(result.factorizations, factorizations + 2);
  EXPECT_EQ(result.reused, 3u);
  ASSERT_EQ(result.substeps.size(), 3u);
  double before = 0;
  for (const Substep& substep : result.substeps) {
    EXPECT_NEAR(substep.fraction - before, 1.0 / 3, 1e-15);
    EXPECT_GT(substep.least_determinant.value, 0);
    EXPECT_GT(substep.amplitude, 0);
    before = substep.fraction;
  }
  EXPECT_EQ(before, 1);
  EXPECT_LT(result.full_step.amplitude, 1);
}

TEST(Splitting, AdaptiveStepsAreSafeAllTheWay) {
  const SplitProblem problem = square_problem(30);
  const Design design = moved_block(2.3, {});
  SplitOptions options;
  options.mode = SplitMode::adaptive;
  const SplitResult result = evaluate_split(problem, design, options);
  ASSERT_TRUE(result.inversion_free);
  EXPECT_GT(result.steps, 1u);
  EXPECT_EQ(result.factorizations, result.steps);
  EXPECT_EQ(result.substeps.size(), result.steps);
  double before = 0;
  for (std::size_t k = 0; k + 1 < result.steps; ++k) {
    const double expected = before + 0.5 * result.substeps[k].amplitude * (1 - before);
    EXPECT_NEAR(result.substeps[k].fraction, expected, 1e-15);
    before = result.substeps[k].fraction;
  }
  EXPECT_EQ(result.substeps[0].amplitude, result.full_step.amplitude);
  EXPECT_EQ(result.substeps.back().fraction, 1);
  expect_prescribed(result, problem, design);
  EXPECT_EQ(InversionCheck(problem.mesh->points, problem.cells).inverted(result.points).count, 0u);
}

// A turn by half a circle shrinks the block to nothing at its middle.
TEST(Splitting, FailsHonestly) {
  const SplitProblem problem = square_problem(20);
  const Design design = moved_block(std::acos(-1), {});
  for (const SplitMode mode : {SplitMode::uniform, SplitMode::adaptive}) {
    SplitOptions options;
    options.mode = mode;
    options.most_steps = 6;
    const SplitResult result = evaluate_split(problem, design, options);
    EXPECT_FALSE(result.inversion_free);
    EXPECT_LE(result.steps, 6u);
    EXPECT_GT(result.reached, 0);
    EXPECT_LT(result.reached, 1);
    ASSERT_FALSE(result.substeps.empty());
    EXPECT_EQ(result.substeps.back().fraction, result.reached);
    EXPECT_EQ(InversionCheck(problem.mesh->points, problem.cells).inverted(result.points).count, 0u);
    const Points full = prepare(problem.mesh, problem.setup)->evaluate(design);
    const SelectedRegions regions = validate(problem.setup, *problem.mesh);
    for (const PointId id : regions.handles[0]) {
      for (std::size_t k = 0; k < 3; ++k) {
        const double x = problem.mesh->points[id][k];
        EXPECT_EQ(result.points[id][k], x + result.reached * (full[id][k] - x));
      }
    }
  }
}

TEST(Splitting, CannotLeaveRestAtAll) {
  const SplitProblem problem = square_problem(20);
  SplitOptions options;
  options.most_steps = 2;
  const SplitResult result = evaluate_split(problem, moved_block(0, {3, 0, 0}), options);
  EXPECT_FALSE(result.inversion_free);
  EXPECT_EQ(result.reached, 0);
  EXPECT_TRUE(result.points == problem.mesh->points);
  EXPECT_TRUE(result.substeps.empty());
  EXPECT_EQ(result.factorizations, 1u);
  EXPECT_EQ(result.steps, 2u);
}

// Two handles that meet after the first step and part in the second: their places coincide, and the attempt says so.
TEST(Splitting, StepsThatCannotBePreparedEndTheirAttempt) {
  const test::Cube cube = test::cube(2);
  SplitProblem problem;
  // Two loose points beside the mesh pass through each other; the middle of the cube is inverted in one step.
  Mesh mesh = cube.mesh;
  mesh.points.insert(mesh.points.end(), {{3, 0, 0}, {4, 0, 0}});
  problem.mesh = test::shared(mesh);
  problem.cells = &cube.elements;
  problem.setup.handles = {{"a", {Region::Ids{{27}}}}, {"b", {Region::Ids{{28}}}}, {"middle", {Region::Ids{{13}}}}};
  problem.setup.fixed = {test::box({-1, -1, -1}, {0.1, 2, 2}), test::box({0.9, -1, -1}, {2, 2, 2})};
  const auto by = [](std::size_t handle, const Vec3& u) { return Motion{handle, std::vector<Vec3>{u}}; };
  SplitOptions options;
  options.most_steps = 2;
  const SplitResult result = evaluate_split(problem, {{}, {by(0, {1, 0, 0}), by(1, {-1, 0, 0}), by(2, {0.6, 0, 0})}}, options);
  EXPECT_FALSE(result.inversion_free);
  ASSERT_EQ(result.attempts.size(), 2u);
  EXPECT_GT(result.attempts[0].inverted, 0u);
  EXPECT_EQ(result.attempts[1].completed, 1u);
  EXPECT_EQ(result.attempts[1].inverted, 0u);
  EXPECT_NE(result.attempts[1].failure.find("coincide"), std::string::npos) << result.attempts[1].failure;
  EXPECT_EQ(result.reached, 0.5);
}

TEST(Splitting, CellsInvertedAtRestAreReported) {
  Mesh mesh = test::square(20);
  std::swap(mesh.face_points[0], mesh.face_points[2]);
  SplitProblem problem;
  problem.mesh = test::shared(mesh);
  problem.setup = block_setup(2);
  problem.cells = problem.mesh.get();
  const SplitResult result = evaluate_split(problem, moved_block(0.4, {}));
  EXPECT_EQ(result.at_rest.count, 1u);
  ASSERT_EQ(result.at_rest.worst.size(), 1u);
  EXPECT_EQ(result.at_rest.worst[0].id, 0u);
  EXPECT_TRUE(result.inversion_free);
  EXPECT_EQ(result.steps, 1u);
}

TEST(Splitting, SameBitsForAnyNumberOfThreads) {
  const SplitProblem problem = square_problem(30);
  RunContext one;
  one.threads = 1;
  const SplitResult a = evaluate_split(problem, moved_block(2.3, {}), {}, one);
  const SplitResult b = evaluate_split(problem, moved_block(2.3, {}));
  EXPECT_TRUE(a.points == b.points);
  EXPECT_EQ(a.full_step.amplitude, b.full_step.amplitude);
}

TEST(Splitting, CancellationAndProgress) {
  const SplitProblem problem = square_problem(30);
  RunContext context;
  context.cancel.emplace();
  std::mutex mutex;
  std::set<std::string> stages;
  context.on_progress = [&](const std::string& stage, double fraction) {
    const std::lock_guard lock(mutex);
    stages.insert(stage);
    if (stage == "split" && fraction > 0.5) context.cancel->cancel();
  };
  test::expect_error(ErrorCode::cancelled, {}, [&] { evaluate_split(problem, moved_block(2.3, {}), {}, context); });
  EXPECT_TRUE(stages.contains("split"));
  EXPECT_GT(stages.size(), 1u);
}

TEST(Splitting, BudgetAndEstimate) {
  SplitProblem problem = square_problem(30);
  const Design design = moved_block(2.3, {});
  const Estimate estimate = estimate_substep(*problem.mesh, problem.setup, problem.cells);
  EXPECT_GT(estimate.peak_bytes, deform::estimate(*problem.mesh, problem.setup).factor_bytes);
  EXPECT_GT(estimate.seconds, 0);
  EXPECT_FALSE(estimate.notes.empty());
  problem.system = prepare(problem.mesh, problem.setup);
  problem.memory_budget = estimate.peak_bytes + 100;
  EXPECT_TRUE(evaluate_split(problem, design).inversion_free);
  problem.memory_budget = estimate.peak_bytes - 100;
  test::expect_error(ErrorCode::out_of_budget, {"available"}, [&] { evaluate_split(problem, design); });
  problem.memory_budget = 1000;
  test::expect_error(ErrorCode::out_of_budget, {"copies of the mesh", "1000"}, [&] { evaluate_split(problem, design); });
}

TEST(Splitting, Refuses) {
  const SplitProblem problem = square_problem(10);
  const auto refused = [&](const SplitOptions& options, const std::vector<const char*>& parts) {
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { evaluate_split(problem, moved_block(0.1, {}), options); });
  };
  SplitOptions options;
  options.most_steps = 0;
  refused(options, {"splitting.most_steps", "0", "1..1000"});
  options.most_steps = 1001;
  refused(options, {"splitting.most_steps", "1001"});
  options.most_steps = 20;
  options.share = 1;
  refused(options, {"splitting.share", "1"});
  options.share = std::nan("");
  refused(options, {"splitting.share"});
  SplitProblem without = problem;
  without.cells = {};
  test::expect_error(ErrorCode::invalid_argument, {"no cells"}, [&] { evaluate_split(without, moved_block(0.1, {})); });
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "out of range"}, [&] {
    evaluate_split(problem, {{}, {{7, identity_affine}}});
  });
  // Out of the plane nothing can be said of faces.
  test::expect_error(ErrorCode::invalid_argument, {"plane z = constant"}, [&] {
    evaluate_split(problem, moved_block(0.1, {0, 0, 0.2}));
  });
}

}  // namespace
}  // namespace deform
