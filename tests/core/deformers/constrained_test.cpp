// SPDX-License-Identifier: GPL-3.0-or-later
// Geometric constraints inside the deformation (thesis 8.5).
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "core/deformers/constrained/constrained_solver.h"
#include "core/deformers/energy/energy_system.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/support/expect_error.h"
#include "tests/support/thesis_options.h"

namespace deform::constrained_test {
namespace {

using test::box;
using test::distance;
using test::shared;

deform::Setup with(std::vector<Constraint> constraints, const ShellOptions& options = {}) {
  deform::Setup setup = test::setup_with_variables();
  setup.method = options;
  setup.constraints = std::move(constraints);
  return setup;
}

Constraint planar(double from, double to, double weight = 0) {
  return {"patch", {box({from, 0.1, -9}, {to, 0.9, 9})}, Planar{}, weight};
}

const Design turned{{0.4, 0.5, 0.2, -0.4}, {}};

TEST(Constrained, APatchBecomesAPlane) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  const auto system = prepare(mesh, with({planar(1.2, 1.6, 1e7)}));
  const auto evaluation = system->bind({&turned, 1}, EvaluationPath::automatic, {});
  const DesignReport& report = evaluation->report(0);
  ASSERT_EQ(report.constraints.size(), 1u);
  EXPECT_TRUE(report.converged);
  EXPECT_GT(report.iterations, 2);
  EXPECT_GT(report.constraints[0].rms_before, 1e-3);
  EXPECT_LT(report.constraints[0].rms, 2e-2 * report.constraints[0].rms_before);
  EXPECT_LE(report.constraints[0].rms, report.constraints[0].max);
  // Handles and fixed points are where they were told to be.
  const Points got = system->evaluate(turned);
  const SelectedRegions regions = validate(with({}), *mesh);
  for (const PointId id : regions.fixed) EXPECT_EQ(got[id], mesh->points[id]);
  const auto motions = handle_motions(with({}), turned.variables);
  for (const PointId id : regions.handles[0]) EXPECT_EQ(got[id], transformed(motions[0], mesh->points[id]));
}

TEST(Constrained, ResidualFallsWithTheWeight) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  double last = HUGE_VAL;
  for (const double weight : {1e3, 1e5, 1e6, 1e8, 1e9}) {
    const auto system = prepare(mesh, with({planar(1.2, 1.6, weight)}));
    const auto evaluation = system->bind({&turned, 1}, EvaluationPath::automatic, {});
    const DesignReport& report = evaluation->report(0);
    EXPECT_TRUE(report.converged) << weight;
    EXPECT_LT(report.constraints[0].rms, last) << weight;
    // In the end with 1 / weight.
    if (weight > 1e8) {
      EXPECT_NEAR(last / report.constraints[0].rms, 10, 1);
    }
    last = report.constraints[0].rms;
  }
}

TEST(Constrained, ConstraintsThatHoldChangeNothing) {
  const auto mesh = shared(test::flat_sheet(41, 21));
  deform::Setup setup = test::sheet_setup();
  setup.method = ShellOptions{};
  setup.constraints = {{"patch", {box({0.8, 0.1, -1}, {1.2, 0.9, 1})}, FixedPlane{{0, 0, 0}, {0, 0, 1}}}};
  const auto system = prepare(mesh, setup);
  Affine slide = identity_affine;
  slide[3] = 0.2;
  const Design design{{}, {{0, slide}}};
  const Points got = system->evaluate(design);
  setup.constraints.clear();
  EXPECT_LT(distance(got, prepare(mesh, setup)->evaluate(design)), 1e-6);
  const Design rest;
  EXPECT_LT(distance(system->evaluate(rest), mesh->points), 1e-12);
}

TEST(Constrained, DesignsDoNotDependOnEachOther) {
  const auto system = prepare(shared(test::bumpy_sheet(31, 16)), with({planar(1.2, 1.6)}));
  std::vector<Design> designs(3, turned);
  designs[0].variables[0] = -0.2;
  designs[2].variables[1] = 0.1;
  RunContext one;
  one.threads = 1;
  const auto together = system->evaluate(designs, EvaluationPath::automatic);
  for (std::size_t i = 0; i < designs.size(); ++i) {
    EXPECT_TRUE(system->evaluate({&designs[i], 1}, EvaluationPath::automatic, one)[0] == together[i]) << i;
  }
}

/// Shell and moving least squares.
std::vector<deform::Setup> energy_setups(const std::vector<Constraint>& constraints) {
  std::vector<deform::Setup> setups(2, with(constraints));
  MlsOptions mls = test::thesis_mls();
  mls.surface_samples = 250;
  setups[1].method = mls;
  return setups;
}

Points points_of(const Evaluation& evaluation, std::size_t design, std::size_t count) {
  Points points(count);
  Vec3* const out = points.data();
  evaluation.evaluate(0, count, design, {&out, 1});
  return points;
}

int steps_of(const Evaluation& evaluation, std::size_t design) {
  return evaluation.report(design).iterations + evaluation.report(design).newton_steps;
}

TEST(Constrained, ASequenceGoesOnWhereTheLastDesignEnded) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  const std::size_t n = mesh->point_count();
  Constraint round = planar(1.2, 1.6, 1e5);
  round.kind = Cylindrical{};
  for (const deform::Setup& setup : energy_setups({round})) {
    const auto system = prepare(mesh, setup);
    std::vector<Design> line(4, turned);
    for (std::size_t i = 0; i < line.size(); ++i) line[i].variables[0] += 0.01 * static_cast<double>(i);
    const auto alone = system->bind(line, EvaluationPath::automatic, {});
    WarmStart warm;
    const auto sequence = system->bind_sequence(line, EvaluationPath::automatic, warm, {});
    for (std::size_t i = 0; i < line.size(); ++i) {
      ASSERT_TRUE(alone->report(i).converged && sequence->report(i).converged) << i;
      const Points expected = points_of(*alone, i, n), got = points_of(*sequence, i, n);
      EXPECT_LT(distance(got, expected), 1e-7) << i;
      EXPECT_NEAR(sequence->report(i).energy, alone->report(i).energy, 1e-6 * alone->report(i).energy) << i;
      if (i == 0) {
        EXPECT_TRUE(got == expected);
      } else {
        EXPECT_LT(steps_of(*sequence, i), steps_of(*alone, i)) << i;
      }
    }
    const auto again = system->bind_sequence({&line.back(), 1}, EvaluationPath::automatic, warm, {});
    EXPECT_LT(steps_of(*again, 0), steps_of(*alone, 3));
    // What belongs to another system is of no use.
    const auto other = prepare(mesh, setup);
    const auto first = other->bind_sequence({line.data(), 1}, EvaluationPath::automatic, warm, {});
    EXPECT_TRUE(points_of(*first, 0, n) == points_of(*alone, 0, n));
    EXPECT_EQ(warm.of.lock(), other);
  }
}

/// The error of the linear solves is relative to the motion of the points, which constraints move while all handles rest.
TEST(Constrained, TheErrorGrowsWithTheMotionOfThePoints) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  Constraint away = planar(1.2, 1.6, 1e6);
  away.kind = FixedPlane{{0, 0, 0.5}, {0, 0, 1}};
  const deform::Setup setups[] = {energy_setups({away})[0], energy_setups({away})[1]};
  for (deform::Setup setup : setups) {
    const auto constrained = prepare(mesh, setup);
    setup.constraints.clear();
    const auto plain = prepare(mesh, setup);
    const DesignReport linear = plain->bind({&turned, 1}, EvaluationPath::direct, {})->report(0);
    const Design rest{std::vector<double>(setup.variables.size(), 0.0), {}};
    const auto evaluation = constrained->bind({&rest, 1}, EvaluationPath::automatic, {});
    const DesignReport report = evaluation->report(0);
    EXPECT_EQ(report.prescribed_displacement, 0);
    const double moved = distance(points_of(*evaluation, 0, mesh->point_count()), mesh->points);
    EXPECT_GT(moved, 0.1);
    EXPECT_GE(report.error, 0.2 * linear.error / linear.prescribed_displacement * moved) << setup.method.index();
  }
}

/// Against solutions to a tolerance that is thousands of times as small.
TEST(Constrained, TheErrorIsWhatIsLeftAfterTheLastStep) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  std::vector<double> ratios;
  for (const ConstraintKind& kind : {ConstraintKind{Planar{}}, ConstraintKind{Cylindrical{}}, ConstraintKind{Spherical{}}}) {
    for (const double weight : {1e4, 1e5, 1e6}) {
      Constraint constraint = planar(1.2, 1.6, weight);
      constraint.kind = kind;
      for (deform::Setup setup : energy_setups({constraint})) {
        const auto system = prepare(mesh, setup);
        setup.constraint_options.tolerance = 1e-12;
        const auto closer = prepare(mesh, setup);
        for (const double turn : {0.2, 0.5, 0.8}) {
          Design design = turned;
          design.variables[1] = turn;
          const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
          const auto limit = closer->bind({&design, 1}, EvaluationPath::automatic, {});
          if (!evaluation->report(0).converged || !limit->report(0).converged) continue;
          const double error =
              distance(points_of(*evaluation, 0, mesh->point_count()), points_of(*limit, 0, mesh->point_count()));
          const double told = evaluation->report(0).error;
          EXPECT_GE(told + limit->report(0).error, 0.5 * error) << weight << ", " << turn;
          if (evaluation->report(0).newton_steps > 1) ratios.push_back(told / error);
        }
      }
    }
  }
  ASSERT_GE(ratios.size(), 20u);
  std::sort(ratios.begin(), ratios.end());
  // 22; with the last step for the error 2,100.
  EXPECT_LE(ratios[ratios.size() / 2], 60);
}

TEST(Constrained, JacobianProducts) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  for (const HandleMode handles : {HandleMode::hard, HandleMode::soft}) {
    ShellOptions options;
    options.handles = handles;
    deform::Setup setup = with({planar(1.2, 1.8, 1e3)}, options);
    setup.constraint_options.tolerance = 1e-11;
    test::check_jacobians(*prepare(mesh, setup), 1e-8, 1e-7, {1e-3, true});
  }
}

// Pairs of points alone, without any set whose points are projected one by one.
TEST(Constrained, JacobianProductsOfDistances) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  Constraint pairs{"pairs", {box({1.0, 0.1, -9}, {1.1, 0.9, 9}), box({1.5, 0.1, -9}, {1.6, 0.9, 9})}, Distance{}, 1e4};
  deform::Setup setup = with({pairs});
  setup.constraint_options.tolerance = 1e-11;
  const auto system = prepare(mesh, setup);
  const auto evaluation = system->bind({&turned, 1}, EvaluationPath::automatic, {});
  EXPECT_TRUE(evaluation->report(0).converged);
  EXPECT_LT(evaluation->report(0).constraints[0].rms, 0.8 * evaluation->report(0).constraints[0].rms_before);
  test::check_jacobians(*system, 1e-8, 1e-7, {1e-3, true});
}

Constraint exact(Constraint constraint) {
  constraint.exact = true;
  return constraint;
}

TEST(ExactConstraints, SingleSetsAreMet) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  for (const deform::Setup& setup : energy_setups({exact(planar(1.2, 1.6))})) {
    const auto system = prepare(mesh, setup);
    const auto evaluation = system->bind({&turned, 1}, EvaluationPath::automatic, {});
    const ConstraintReport& report = evaluation->report(0).constraints[0];
    EXPECT_GT(report.rms_before, 1e-3);
    EXPECT_LT(report.max, 1e-9 * system->info().diagonal);
    EXPECT_FALSE(report.missed);
    // The points themselves, fitted again.
    const Points got = system->evaluate(turned);
    std::vector<Vec3> patch;
    for (const PointId id : select(setup.constraints[0].regions[0], *mesh, "patch")) patch.push_back(got[id]);
    std::vector<Vec3> projected(patch.size());
    ShapeParameters shape;
    make_projection(Planar{}, std::vector<std::vector<Vec3>>{patch})->project(patch, projected, shape);
    EXPECT_LT(distance(patch, projected), 1e-9 * system->info().diagonal);
    // Fixed points stay, and the rest moves by no more than a few times what the patch was away.
    const SelectedRegions regions = validate(setup, *mesh);
    for (const PointId id : regions.fixed) EXPECT_EQ(got[id], mesh->points[id]);
    deform::Setup soft = setup;
    soft.constraints[0].exact = false;
    EXPECT_LT(distance(got, prepare(mesh, soft)->evaluate(turned)), 3 * report.max_before);
  }
}

TEST(ExactConstraints, OverlappingSetsAndHeldPointsAreMetTogether) {
  const auto mesh = shared(test::flat_sheet(41, 21));
  // A plane and a straight line in it that starts in the fixed region; a given plane across.
  const Constraint line{"line", {box({0, 0.49, -9}, {1.2, 0.51, 9})}, Straight{}};
  const Constraint across{"across", {box({0.79, 0, -9}, {0.81, 1, 9})}, FixedPlane{{0.8, 0, 0}, {1, 0, 0}}};
  for (const deform::Setup& setup : energy_setups({exact(planar(0.5, 1.3, 1e5)), exact(line), exact(across)})) {
    const auto system = prepare(mesh, setup);
    const auto evaluation = system->bind({&turned, 1}, EvaluationPath::automatic, {});
    for (const ConstraintReport& report : evaluation->report(0).constraints) {
      EXPECT_LT(report.max, 1e-9 * system->info().diagonal);
      EXPECT_FALSE(report.missed);
    }
  }
}

TEST(ExactConstraints, ContradictionsAreReported) {
  const auto mesh = shared(test::flat_sheet(41, 21));
  Constraint low{"low", {box({1.2, 0.1, -9}, {1.5, 0.9, 9})}, FixedPlane{{0, 0, 0}, {0, 0, 1}}};
  Constraint high = low;
  high.name = "high";
  high.kind = FixedPlane{{0, 0, 0.1}, {0, 0, 1}};
  const auto system = prepare(mesh, with({exact(low), exact(high)})), soft = prepare(mesh, with({low, high}));
  const auto evaluation = system->bind({&turned, 1}, EvaluationPath::automatic, {});
  const auto soft_evaluation = soft->bind({&turned, 1}, EvaluationPath::automatic, {});
  for (std::size_t i = 0; i < 2; ++i) {
    const ConstraintReport& report = evaluation->report(0).constraints[i];
    EXPECT_TRUE(report.missed);
    EXPECT_TRUE(report.given_up) << "one of them would be met where the other is twice as far";
    EXPECT_NEAR(report.max, soft_evaluation->report(0).constraints[i].max, 1e-12);
    EXPECT_NEAR(report.max, 0.05, 5e-3);
  }
}

TEST(ExactConstraints, JacobianProducts) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  const Constraint line{"line", {box({0, 0.45, -9}, {1.4, 0.55, 9})}, Straight{}, 1e5};
  for (deform::Setup& setup : energy_setups({exact(planar(1.2, 1.7, 1e3))})) {
    setup.constraint_options.tolerance = 1e-11;
    test::check_jacobians(*prepare(mesh, setup), 1e-8, 1e-7, {1e-3, true});
  }
  for (deform::Setup& setup : energy_setups({exact(planar(0.9, 1.8, 1e5)), exact(line)})) {
    setup.constraint_options.tolerance = 1e-11;
    test::check_jacobians(*prepare(mesh, setup), 1e-8, 1e-7, {1e-3, true});
  }
}

TEST(Constrained, BadOnesAreRefused) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  const auto refused = [&](std::vector<Constraint> constraints, const std::vector<const char*>& parts) {
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { prepare(mesh, with(std::move(constraints))); });
  };
  refused({{"", {{Region::All{}}}, Planar{}}}, {"constraints[0].name", "empty"});
  refused({planar(0, 2), planar(0, 1)}, {"constraints[1].name", "twice"});
  refused({{"patch", {}, Planar{}}}, {"constraints[0].regions", "planar", "got 0"});
  refused({planar(5, 6)}, {"constraints[0].regions[0]", "no point"});
  refused({planar(0, 1, -1)}, {"constraints[0].weight", "-1"});
  refused({{"patch", {{Region::Ids{{1, 2}}}}, Planar{}}}, {"constraints[0]"});
  deform::Setup rbf = with({planar(0, 1)});
  rbf.method = RbfOptions{};
  test::expect_error(ErrorCode::invalid_argument, {"constraints", "method.rbf", "shell"}, [&] { prepare(mesh, rbf); });
  const auto system = prepare(mesh, with({planar(1.2, 1.6)}));
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "BASIS"}, [&] {
    system->bind({&turned, 1}, EvaluationPath::basis, {});
  });
}

TEST(Constrained, StopsWhenTold) {
  const auto system = prepare(shared(test::bumpy_sheet(21, 11)), with({planar(1.2, 1.6)}));
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  test::expect_error(ErrorCode::cancelled, {}, [&] { system->bind({&turned, 1}, EvaluationPath::automatic, context); });
}

}  // namespace
}  // namespace deform::constrained_test
