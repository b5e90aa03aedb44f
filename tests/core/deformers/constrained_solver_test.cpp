// SPDX-License-Identifier: GPL-3.0-or-later
// The minimum of energy and distances from shapes on random problems: the objective never rises, it is that of its definition,
// and nothing nearby is lower.
#include "core/deformers/constrained/constrained_solver.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "core/base/vectors.h"
#include "core/constraints/constraint.h"

namespace deform::constrained_solver_test {
namespace {

struct Problem {
  std::int64_t functions;
  int patience;  ///< before Newton steps
  double weight;
};

class ConstrainedSolverTest : public testing::Test {
 protected:
  static constexpr PointId points = 40;

  double value() { return std::uniform_real_distribution<double>(-1, 1)(random_); }
  Eigen::MatrixXd values(Eigen::Index rows, Eigen::Index columns) {
    return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return value(); });
  }

  /// Its points are near a shape.
  ConstraintSet set_of(const ConstraintKind& kind, PointId first, PointId end, double weight) {
    ConstraintSet set;
    for (PointId id = first; id < end; ++id) {
      const double t = 0.3 * id, z = 0.2 * value();
      set.ids.push_back(id);
      set.rest.push_back({std::cos(t) + 0.1 * value(), std::sin(t) + 0.1 * value(), z});
    }
    set.projection = make_projection(kind, std::vector<std::vector<Vec3>>{set.rest}, {});
    set.weight = weight;
    return set;
  }

  std::mt19937 random_{7};
};

class ConstrainedSolverMinimum : public ConstrainedSolverTest, public testing::WithParamInterface<Problem> {};

TEST_P(ConstrainedSolverMinimum, FindsAMinimumByStepsThatNeverRise) {
  const auto [functions, patience, weight] = GetParam();
  EnergySolver::Problem problem;
  const Eigen::MatrixXd root = values(functions, functions);
  const Eigen::MatrixXd K = root * root.transpose() + Eigen::MatrixXd::Identity(functions, functions);
  problem.energy = SparseMatrix(Eigen::MatrixXd(K.triangularView<Eigen::Lower>()).sparseView());
  const Eigen::MatrixXd coupling = values(functions, 3);
  problem.coupling = SparseMatrix(coupling.sparseView());
  const EnergySolver solver(problem, 0, {});
  const Eigen::MatrixXd phi = 0.3 * values(points, functions), h = values(3, 3);
  const SparseRows rows = SparseRows(phi.sparseView());
  const std::vector<ConstraintSet> sets{set_of(Circular{}, 0, 16, weight), set_of(Planar{}, 12, 30, 2 * weight),
                                        set_of(Spherical{}, 22, points, 0.5 * weight)};
  ConstrainedSolver::Options options;
  options.patience = patience;
  options.tolerance = 1e-9;
  const ConstrainedSolver constrained(solver, rows, sets, options, 0, {});
  std::size_t count = 0;
  for (const ConstraintSet& set : sets) count += set.ids.size();
  const ConstrainedResult result = constrained.solve(h, std::vector<Vec3>(count), {});
  EXPECT_TRUE(result.converged) << result.error;
  EXPECT_LE(result.error, options.tolerance);
  EXPECT_EQ(result.newton_steps > 0, patience < 1000);
  ASSERT_GT(result.objectives.size(), 3u);
  for (std::size_t i = 1; i < result.objectives.size(); ++i) {
    EXPECT_LE(result.objectives[i], result.objectives[i - 1] * (1 + 1e-12)) << i;
  }

  const Eigen::MatrixXd free = K.ldlt().solve(coupling * h);
  EXPECT_LT((result.free - free).norm(), 1e-9 * free.norm());
  const auto objective = [&](const Eigen::MatrixXd& w) {
    double sum = ((w - free).transpose() * K * (w - free)).trace();
    for (std::size_t t = 0; t < sets.size(); ++t) {
      std::vector<Vec3> x, onto(sets[t].ids.size());
      for (std::size_t i = 0; i < onto.size(); ++i) {
        const Eigen::RowVector3d u = phi.row(sets[t].ids[i]) * w;
        x.push_back(sets[t].rest[i] + Vec3{u[0], u[1], u[2]});
      }
      ShapeParameters shape = result.after.shapes[t];
      const double squares = sets[t].projection->project(x, onto, shape);
      sum += sets[t].weight / static_cast<double>(onto.size()) * squares;
    }
    return sum;
  };
  const double least = objective(result.w);
  EXPECT_NEAR(result.objectives.back(), least, 1e-6 * least);
  EXPECT_LT(least, 0.99 * objective(free)) << "the shapes count";
  for (int k = 0; k < 40; ++k) {
    const Eigen::MatrixXd step = 1e-3 * values(functions, 3);
    EXPECT_GE(objective(result.w + step), least * (1 - 1e-9)) << k;
  }
}

/// Accelerated steps overshoot where the shapes are ill determined and stiff: those that would rise are not taken.
TEST_F(ConstrainedSolverTest, NeverRisesHoweverStiff) {
  for (unsigned seed = 1; seed <= 8; ++seed) {
    random_.seed(seed);
    const Eigen::MatrixXd root = values(12, 12);
    const Eigen::MatrixXd K = root * root.transpose() + 0.01 * Eigen::MatrixXd::Identity(12, 12);
    EnergySolver::Problem problem;
    problem.energy = SparseMatrix(Eigen::MatrixXd(K.triangularView<Eigen::Lower>()).sparseView());
    problem.coupling = SparseMatrix(values(12, 3).sparseView());
    const EnergySolver solver(problem, 0, {});
    const SparseRows rows = SparseRows((0.5 * values(points, 12)).sparseView());
    const double weight = std::pow(10, 2 + 2 * value());
    const std::vector<ConstraintSet> sets{set_of(Circular{}, 0, 9, weight), set_of(Cylindrical{}, 5, 20, weight),
                                          set_of(Conical{}, 15, points, weight)};
    std::size_t count = 0;
    for (const ConstraintSet& set : sets) count += set.ids.size();
    ConstrainedSolver::Options options;
    options.patience = 5000;
    options.tolerance = 1e-10;
    options.most_iterations = 150;
    const ConstrainedSolver constrained(solver, rows, sets, options, 0, {});
    const ConstrainedResult result = constrained.solve(values(3, 3), std::vector<Vec3>(count), {});
    for (std::size_t i = 1; i < result.objectives.size(); ++i) {
      EXPECT_LE(result.objectives[i], result.objectives[i - 1] * (1 + 1e-12)) << seed << ' ' << i;
    }
  }
}

class ConstrainedSolverDerivative : public ConstrainedSolverTest, public testing::WithParamInterface<HandleEnforcement> {};

/// Against differences of solutions; and the adjoint against the derivative.
TEST_P(ConstrainedSolverDerivative, IsThatOfTheSolution) {
  constexpr Eigen::Index functions = 14, held = 5;
  EnergySolver::Problem problem;
  problem.enforcement = GetParam();
  const Eigen::MatrixXd root = values(functions, functions);
  const Eigen::MatrixXd K = root * root.transpose() + Eigen::MatrixXd::Identity(functions, functions);
  problem.energy = SparseMatrix(Eigen::MatrixXd(K.triangularView<Eigen::Lower>()).sparseView());
  problem.coupling = SparseMatrix(values(functions, held).sparseView());
  problem.weights = Eigen::VectorXd::NullaryExpr(held, [&] { return 2 + value(); });
  const EnergySolver solver(problem, 0, {});
  const SparseRows rows = SparseRows((0.3 * values(points, functions)).sparseView());
  const std::vector<ConstraintSet> sets{set_of(Circular{}, 0, 16, 100), set_of(Planar{}, 12, 30, 50),
                                        set_of(Spherical{}, 22, points, 80)};
  std::size_t count = 0;
  for (const ConstraintSet& set : sets) count += set.ids.size();
  ConstrainedSolver::Options options;
  options.tolerance = 1e-11;
  const ConstrainedSolver constrained(solver, rows, sets, options, 0, {});
  const bool with_offsets = GetParam() == HandleEnforcement::eliminated;  // others have none
  std::vector<Vec3> offsets(count), change(count);
  for (std::size_t i = 0; i < count && with_offsets; ++i) {
    offsets[i] = {0.05 * value(), 0.05 * value(), 0.05 * value()};
    change[i] = {value(), value(), value()};
  }
  const Eigen::MatrixXd h = values(held, 3), dh = values(held, 3), g = values(functions, 3);
  const auto solved = [&](double step) {
    std::vector<Vec3> moved = offsets;
    for (std::size_t i = 0; i < count; ++i) moved[i] = moved[i] + step * change[i];
    return constrained.solve(h + step * dh, moved, {});
  };
  const ConstrainedResult at = solved(0);
  ASSERT_TRUE(at.converged);
  const Eigen::MatrixXd dw = constrained.derivative(at, dh, change, {});
  const Eigen::MatrixXd quotient = (solved(1e-5).w - solved(-1e-5).w) / 2e-5;
  EXPECT_LT((dw - quotient).norm(), 1e-5 * quotient.norm());
  const ConstrainedSolver::Adjoint back = constrained.adjoint(at, g, {});
  double sum = back.h.cwiseProduct(dh).sum();
  for (std::size_t i = 0; i < count; ++i) sum += dot(back.offsets[i], change[i]);
  EXPECT_NEAR(sum, g.cwiseProduct(dw).sum(), 1e-8 * g.norm() * dw.norm());
}

INSTANTIATE_TEST_SUITE_P(Enforcements, ConstrainedSolverDerivative,
                         testing::Values(HandleEnforcement::eliminated, HandleEnforcement::soft, HandleEnforcement::multipliers));

INSTANTIATE_TEST_SUITE_P(Problems, ConstrainedSolverMinimum,
                         testing::Values(Problem{8, 0, 10}, Problem{8, 5000, 10}, Problem{8, 5000, 1000}, Problem{20, 0, 100},
                                         Problem{20, 5000, 100}, Problem{40, 0, 1000}, Problem{40, 5000, 30}));

}  // namespace
}  // namespace deform::constrained_solver_test
