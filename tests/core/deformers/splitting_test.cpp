// SPDX-License-Identifier: GPL-3.0-or-later
// Splitting: what a step starts from and ends at, what is counted, how it fails, what it refuses. That it helps is tested in
// tests/thesis/splitting_rows_test.cpp.
#include "core/deformers/splitting.h"

#include <gtest/gtest.h>

#include <mutex>
#include <set>

#include "tests/core/deformers/block_meshes.h"
#include "tests/core/deformers/space_cases.h"
#include "tests/support/expect_error.h"

namespace deform::splitting_test {
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

/// The points of the handle all go by u(place), in the plane.
template <typename Move>
Design moved_points(const SplitProblem& problem, const Move& move) {
  const SelectedRegions regions = validate(problem.setup, *problem.mesh);
  std::vector<Vec3> displacements;
  for (const PointId id : regions.handles[0]) displacements.push_back(move(problem.mesh->points[id]));
  return {{}, {{0, displacements}}};
}

/// The same turn as moved_block(angle, {}), point by point: every point goes straight.
Design straight_turn(const SplitProblem& problem, double angle) {
  return moved_points(problem, [&](const Vec3& x) {
    const double u = x[0] - 0.5, v = x[1] - 0.5, c = std::cos(angle) - 1, s = std::sin(angle);
    return Vec3{c * u - s * v, s * u + c * v, 0};
  });
}

// Step by step by hand: regions stay the points they were, every system is prepared where the step before ended.
TEST(Splitting, StepsAreThoseOfTheThesis) {
  const SplitProblem problem = square_problem(30);
  for (const bool arcs : {true, false}) {
    SCOPED_TRACE(arcs);
    const Design design = arcs ? moved_block(2.3, {}) : straight_turn(problem, 2.3);
    const SplitResult result = evaluate_split(problem, design);
    ASSERT_TRUE(result.inversion_free);
    const auto n = static_cast<int>(result.steps);
    ASSERT_GT(n, 1);
    const Points& rest = problem.mesh->points;
    const Points full = prepare(problem.mesh, problem.setup)->evaluate(design);
    const SelectedRegions regions = validate(problem.setup, *problem.mesh);
    Points at = rest;
    for (int k = 1; k <= n; ++k) {
      auto moved = std::make_shared<Mesh>(*problem.mesh);
      moved->points = at;
      deform::Setup setup;
      setup.method = problem.setup.method;
      setup.handles = {{"block", {Region::Ids{regions.handles[0]}}}};
      setup.fixed = {{Region::Ids{regions.fixed}}};
      const double t = double(k) / n, c = std::cos(2.3 * t), s = std::sin(2.3 * t);
      std::vector<Vec3> displacements;
      for (const PointId id : regions.handles[0]) {
        const double x = rest[id][0] - 0.5, y = rest[id][1] - 0.5;
        const Vec3 turned{0.5 + c * x - s * y, 0.5 + s * x + c * y, 0};
        Vec3& u = displacements.emplace_back();
        for (std::size_t i = 0; i < 3; ++i) {
          u[i] = (arcs ? turned[i] : rest[id][i] + t * (full[id][i] - rest[id][i])) - at[id][i];
        }
      }
      at = prepare(moved, setup)->evaluate({{}, {{0, displacements}}});
    }
    EXPECT_LT(test::distance(at, result.points), 1e-10);
    expect_prescribed(result, problem, design);
  }
}

// The samples of incremental QR are values of the variables, which steps after the first do not have.
TEST(Splitting, StepsOfASetupWithSamples) {
  SplitProblem problem = square_problem(30);
  RbfOptions options;
  options.solver = Solver::incremental_qr;
  options.samples = {{0.3}};
  problem.setup.method = options;
  problem.setup.variables = {{"turn", "block", DesignVariable::Rotate{{0, 0, 1}, {0.5, 0.5, 0}}}};
  const SplitResult result = evaluate_split(problem, Design{{2.3}, {}});
  EXPECT_GT(result.factorizations, 1u);
  for (const SplitAttempt& attempt : result.attempts) EXPECT_EQ(attempt.failure, "");
  EXPECT_TRUE(result.inversion_free);
}

TEST(Splitting, CountsWhatItDid) {
  const SplitProblem problem = square_problem(30);
  const SplitResult result = evaluate_split(problem, straight_turn(problem, 2.3));
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

// Straight, a turn by half a circle would shrink the block to nothing at its middle, in however many steps.
TEST(Splitting, RotationsArrive) {
  SplitProblem problem = square_problem(30);
  problem.setup.handles[0].region = test::box({0.449, 0.449, -1}, {0.551, 0.551, 1});
  problem.setup.variables = {{"turn", "block", DesignVariable::Rotate{{0, 0, 1}, {0.5, 0.5, 0}}},
                             {"size", "block", DesignVariable::Scale{{0.5, 0.5, 0}, {}}}};
  const InversionCheck check(problem.mesh->points, problem.cells);
  const double half = std::acos(-1);
  // Stretched by 1.2 along x, then turned, as one map.
  Design stretched = moved_block(half, {});
  Affine& motion = std::get<Affine>(stretched.motions[0].value);
  for (std::size_t i = 0; i < 2; ++i) {
    motion[4 * i + 3] -= 0.5 * 0.2 * motion[4 * i];
    motion[4 * i] *= 1.2;
  }
  for (const Design& design : {moved_block(half, {}), moved_block(-half, {0.02, -0.01, 0}), Design{{half, 0}, {}},
                               Design{{-half, 0.1}, {}}, stretched}) {
    for (const SplitMode mode : {SplitMode::uniform, SplitMode::adaptive}) {
      SplitOptions options;
      options.mode = mode;
      const SplitResult result = evaluate_split(problem, design, options);
      EXPECT_TRUE(result.inversion_free) << result.reached;
      EXPECT_EQ(result.reached, 1);
      EXPECT_FALSE(result.straight);
      EXPECT_LT(result.full_step.amplitude, 0.7);
      EXPECT_EQ(check.inverted(result.points).count, 0u);
      EXPECT_EQ(check.inverted(result.points).least_determinant.value, result.least_determinant.value);
      expect_prescribed(result, problem, design);
    }
  }
  SplitOptions options;
  options.most_steps = 8;
  EXPECT_FALSE(evaluate_split(problem, straight_turn(problem, half), options).inversion_free);
}

// What arrives nowhere is delivered as far as it is safe, and never less than the full step bears.
TEST(Splitting, FailsHonestly) {
  const SplitProblem problem = square_problem(20);
  const InversionCheck check(problem.mesh->points, problem.cells);
  const Points& rest = problem.mesh->points;
  const SelectedRegions regions = validate(problem.setup, *problem.mesh);
  const Design turn = straight_turn(problem, std::acos(-1)), out = moved_block(0, {3, 0, 0}), far = moved_block(2, {0.6, 0.1, 0});
  for (const Design& design : {turn, out, far}) {
    const Points full = prepare(problem.mesh, problem.setup)->evaluate(design);
    const double safe = check.amplitude(rest, full).amplitude;
    for (const SplitMode mode : {SplitMode::uniform, SplitMode::adaptive}) {
      SplitOptions options;
      options.mode = mode;
      options.most_steps = 4;
      const SplitResult result = evaluate_split(problem, design, options);
      EXPECT_FALSE(result.inversion_free);
      EXPECT_LE(result.steps, 4u);
      EXPECT_GE(result.reached, safe * (1 - 1e-9));
      EXPECT_GT(result.reached, 0);
      EXPECT_LT(result.reached, 1);
      ASSERT_FALSE(result.substeps.empty());
      EXPECT_EQ(result.substeps.back().fraction, result.reached);
      EXPECT_EQ(result.substeps.back().least_determinant.value, result.least_determinant.value);
      EXPECT_EQ(check.inverted(result.points).count, 0u);
      EXPECT_GT(result.least_determinant.value, 0);
      for (const PointId id : regions.handles[0]) {
        for (std::size_t k = 0; k < 3 && &design != &far; ++k) {
          EXPECT_NEAR(result.points[id][k], rest[id][k] + result.reached * (full[id][k] - rest[id][k]),
                      result.straight ? 0 : 1e-15);
        }
      }
      if (!result.straight) continue;
      for (std::size_t i = 0; i < rest.size(); ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
          EXPECT_NEAR(result.points[i][k], rest[i][k] + result.reached * (full[i][k] - rest[i][k]), 1e-15);
        }
      }
    }
  }
}

// At least the margin is kept where the cells have it at rest, on the last bit of the way, too.
TEST(Splitting, KeepsAMargin) {
  SplitProblem problem = square_problem(20);
  problem.setup.variables = {{"turn", "block", DesignVariable::Rotate{{0, 0, 1}, {0.5, 0.5, 0}}}};
  const InversionCheck check(problem.mesh->points, problem.cells);
  for (const double angle : {3.5, 4.0}) {
    double before = 1;
    for (const double margin : {0.0, 0.1, 0.3, 0.6}) {
      SplitOptions options;
      options.margin = margin;
      options.most_steps = 3;
      const SplitResult far = evaluate_split(problem, {{angle}, {}}, options);
      EXPECT_FALSE(far.inversion_free);
      EXPECT_GE(far.least_determinant.value, margin);
      EXPECT_EQ(far.least_determinant.value, check.inverted(far.points).least_determinant.value);
      EXPECT_LE(far.reached, before) << margin;
      EXPECT_GT(far.reached, 0);
      before = far.reached;
    }
  }
  // A motion whose full step inverts nothing but has less.
  const Design design = moved_block(0.9, {});
  const double least = check.inverted(prepare(problem.mesh, problem.setup)->evaluate(design)).least_determinant.value;
  ASSERT_GT(least, 0);
  SplitOptions options;
  options.margin = 1.05 * least;
  const SplitResult split = evaluate_split(problem, design, options);
  EXPECT_GT(split.steps, 1u);
  EXPECT_GE(split.least_determinant.value, options.margin);
  // Cells that have less at rest do not end every motion.
  SplitProblem sheared = problem;
  Mesh mesh = *problem.mesh;
  mesh.points[0] = {0.04, 0.04, 0};
  sheared.mesh = test::shared(mesh);
  sheared.cells = sheared.mesh.get();
  options.margin = 0.5;
  ASSERT_LT(InversionCheck(mesh.points, sheared.cells).at_rest().least_determinant.value, 0.5);
  EXPECT_TRUE(evaluate_split(sheared, moved_block(0.1, {}), options).inversion_free);
}

/// Beyond the last sound step the motion goes on as far as ten halvings of what is left can tell: by hand, from where it is.
TEST(Splitting, GoesOnByHalvings) {
  SplitProblem problem = square_problem(20);
  problem.setup.variables = {{"turn", "block", DesignVariable::Rotate{{0, 0, 1}, {0.5, 0.5, 0}}}};
  const auto system = prepare(problem.mesh, problem.setup);
  const InversionCheck check(problem.mesh->points, problem.cells);
  const auto at = [&](double angle) { return system->evaluate(Design{{angle}, {}}); };
  const double angle = 2.4;
  double sound = 0, wrong = 1;
  for (int k = 0; k < 10; ++k) {
    const double fraction = 0.5 * (sound + wrong);
    (check.inverted(at(angle * fraction)).count == 0 ? sound : wrong) = fraction;
  }
  ASSERT_GT(sound, 0);
  SplitOptions options;
  options.most_steps = 1;
  const SplitResult result = evaluate_split(problem, {{angle}, {}}, options);
  ASSERT_FALSE(result.straight);
  EXPECT_EQ(result.reached, sound);
  EXPECT_LT(test::distance(result.points, at(angle * sound)), 1e-12);
  ASSERT_EQ(result.substeps.size(), 1u);
  EXPECT_EQ(result.substeps[0].fraction, sound);
  EXPECT_EQ(result.substeps[0].amplitude, check.amplitude(problem.mesh->points, result.points).amplitude);
  EXPECT_EQ(result.substeps[0].least_determinant.value, check.inverted(result.points).least_determinant.value);
  EXPECT_EQ(result.steps, 1u);
  EXPECT_EQ(result.factorizations, 1u);
  EXPECT_EQ(result.reused, 1u);
}

TEST(Splitting, FarMotionsGoAsFarAsTheFullStepBears) {
  const SplitProblem problem = square_problem(20);
  SplitOptions options;
  options.most_steps = 2;
  const SplitResult result = evaluate_split(problem, moved_block(0, {3, 0, 0}), options);
  EXPECT_FALSE(result.inversion_free);
  EXPECT_GE(result.reached, result.full_step.amplitude * (1 - 1e-9));
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
  EXPECT_GE(result.reached, 0.5);
  EXPECT_GE(result.reached, result.full_step.amplitude * (1 - 1e-9));
}

/// Regions of constraints and of options are those of the shape at rest in each step, whatever comes into them or leaves them.
TEST(Splitting, RegionsAreThoseAtRest) {
  SplitProblem by_place;
  const Mesh cube = test::solid_cube(6);
  by_place.mesh = test::shared(cube);
  by_place.cells = by_place.mesh->elements.get();
  by_place.setup.handles = {{"top", test::box({-1, -1, 0.99}, {2, 2, 2})}};
  by_place.setup.fixed = {test::box({-1, -1, -1}, {2, 2, 0.01})};
  SplitOptions options;
  options.most_steps = 12;
  MlsOptions mls;
  mls.surface_samples = 100;
  mls.volume_samples = 50;
  for (const bool constraint : {false, true}) {
    SCOPED_TRACE(constraint);
    SplitProblem by_points = by_place;
    // Motions that invert cells in one step.
    const Region above = test::box({-1, -1, constraint ? 0.8 : 0.6}, {2, 2, 0.9});
    const Design turn = constraint ? moved_block(3.1, {0, 0, -0.45}) : moved_block(3, {0, 0, -0.3});
    const Region points{Region::Ids{select(above, cube, "above")}};
    for (SplitProblem* const problem : {&by_place, &by_points}) {
      const Region& region = problem == &by_place ? above : points;
      mls.weights.clear();
      problem->setup.constraints.clear();
      if (constraint) {
        problem->setup.constraints = {{"plane", {region}, Planar{}, 100}};
      } else {
        mls.weights = {{region, 100, 1}};
      }
      problem->setup.method = mls;
    }
    for (const SplitMode mode : {SplitMode::uniform, SplitMode::adaptive}) {
      options.mode = mode;
      const SplitResult placed = evaluate_split(by_place, turn, options), pointed = evaluate_split(by_points, turn, options);
      EXPECT_GT(placed.substeps.size(), 1u);
      EXPECT_EQ(placed.reached, pointed.reached);
      EXPECT_TRUE(placed.points == pointed.points);
    }
  }
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
  std::stop_source stop;
  context.stop = stop.get_token();
  std::mutex mutex;
  std::set<std::string> stages;
  context.on_progress = [&](const std::string& stage, double fraction) {
    const std::lock_guard lock(mutex);
    stages.insert(stage);
    if (stage == "split" && fraction > 0.5) stop.request_stop();
  };
  test::expect_error(ErrorCode::cancelled, {}, [&] { evaluate_split(problem, straight_turn(problem, 2.3), {}, context); });
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
  EXPECT_EQ(estimate.basis_bytes, 0u) << "steps after the first have no use for a basis";
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
  options.share = 0.5;
  for (const double margin : {-0.1, 1.0, std::nan("")}) {
    options.margin = margin;
    refused(options, {"splitting.margin", "below 1"});
  }
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
}  // namespace deform::splitting_test
