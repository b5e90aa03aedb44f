// SPDX-License-Identifier: GPL-3.0-or-later
// How far solutions of the energy methods may be off, against dense solutions in extended precision.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <random>

#include "core/deformers/constrained/energy_solver.h"
#include "tests/support/linear_algebra.h"

namespace deform::solver_error_test {
namespace {

using Matrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;

constexpr std::int64_t unknowns = 160, held = 12;

/// Bending of a rod of random stiffness, clamped at one end: condition about 1e10.
SparseMatrix rod(std::mt19937& random) {
  SparseMatrix second(unknowns, unknowns);
  for (std::int64_t i = 0; i < unknowns; ++i) {
    const double stiffness = std::uniform_real_distribution<double>(0.5, 2)(random);
    second.insert(i, i) = stiffness;
    if (i >= 1) second.insert(i, i - 1) = -2 * stiffness;
    if (i >= 2) second.insert(i, i - 2) = stiffness;
  }
  const SparseMatrix square = SparseMatrix(second.transpose()) * second;
  SparseMatrix lower = square.triangularView<Eigen::Lower>();
  lower.makeCompressed();
  return lower;
}

SparseMatrix random_coupling(std::mt19937& random) {
  std::uniform_real_distribution<double> value(-1, 1);
  SparseMatrix coupling(unknowns, held);
  for (std::int64_t j = 0; j < held; ++j) {
    const std::int64_t at = 5 + j * (unknowns - 10) / held;
    for (std::int64_t i = at; i < at + 3; ++i) coupling.insert(i, j) = value(random);
  }
  coupling.makeCompressed();
  return coupling;
}

/// The solution in extended precision.
Matrix reference(const EnergySolver::Problem& problem, const Eigen::MatrixXd& h) {
  const Matrix lower = Eigen::MatrixXd(problem.energy).cast<long double>();
  Matrix K = lower.selfadjointView<Eigen::Lower>();
  const Matrix B = Eigen::MatrixXd(problem.coupling).cast<long double>().transpose();
  const Matrix H = h.cast<long double>();
  if (problem.enforcement == HandleEnforcement::eliminated) return test::lu_solution(K, test::product(B.transpose(), H));
  if (problem.enforcement == HandleEnforcement::soft) {
    const Matrix W = problem.weights.cast<long double>().asDiagonal();
    return test::lu_solution(K + test::product(test::product(B.transpose(), W), B),
                             test::product(test::product(B.transpose(), W), H));
  }
  const Matrix W = problem.weights.cast<long double>().asDiagonal();
  const Matrix weighted = test::product(B.transpose(), W), A = K + test::product(weighted, B);
  Matrix u = H, w;
  for (int step = 0; step < EnergySolver::multiplier_steps; ++step) {
    w = test::lu_solution(A, test::product(weighted, u));
    u += H - test::product(B, w);
  }
  return w;
}

class SolverError : public testing::TestWithParam<HandleEnforcement> {};

TEST_P(SolverError, IsWhatItsUncertaintySays) {
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    std::mt19937 random(seed);
    EnergySolver::Problem problem;
    problem.energy = rod(random);
    problem.coupling = random_coupling(random);
    problem.enforcement = GetParam();
    if (GetParam() != HandleEnforcement::eliminated) {
      problem.weights = Eigen::VectorXd::Constant(held, 1000);
      if (GetParam() == HandleEnforcement::multipliers) {
        problem.weights = multiplier_weights(problem.energy, problem.coupling, Eigen::VectorXd::LinSpaced(held, 1, 0.5));
      }
    }
    const EnergySolver solver(problem, 0, {});
    Eigen::MatrixXd h(held, 2);
    for (double& x : h.reshaped()) x = std::uniform_real_distribution<double>(-1, 1)(random);
    const Eigen::MatrixXd u = solver.loads(h, {});
    const Eigen::MatrixXd w = solver.solve_loads(u, {});
    const Eigen::MatrixXd uncertainty = solver.uncertainty(u, w, {});
    const Matrix exact = reference(problem, h);
    for (Eigen::Index c = 0; c < 2; ++c) {
      const double truth = static_cast<double>((w.col(c).cast<long double>() - exact.col(c)).cwiseAbs().maxCoeff());
      const double said = uncertainty.col(c).cwiseAbs().maxCoeff();
      EXPECT_GE(said, 0.5 * truth) << seed;
      EXPECT_LE(said, 2 * truth + 1e-15 * w.col(c).cwiseAbs().maxCoeff()) << seed;
      EXPECT_GT(truth, 1e-15 * w.col(c).cwiseAbs().maxCoeff()) << "the rod is too easy to show anything";
    }
  }
}

/// Where handles can be met, the steps must end at the least energy that meets them: the solution of the saddle-point system.
TEST(MultiplierSteps, ComeToTheConstrainedMinimum) {
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    std::mt19937 random(seed);
    EnergySolver::Problem problem;
    problem.energy = rod(random);
    problem.coupling = random_coupling(random);
    problem.enforcement = HandleEnforcement::multipliers;
    problem.weights = multiplier_weights(problem.energy, problem.coupling, Eigen::VectorXd::Ones(held));
    Eigen::MatrixXd h(held, 1);
    for (double& x : h.reshaped()) x = std::uniform_real_distribution<double>(-1, 1)(random);
    const Eigen::MatrixXd w = EnergySolver(problem, 0, {}).solve(h, {});
    const Matrix lower = Eigen::MatrixXd(problem.energy).cast<long double>();
    const Matrix K = lower.selfadjointView<Eigen::Lower>();
    const Matrix B = Eigen::MatrixXd(problem.coupling).transpose().cast<long double>();
    Matrix saddle = Matrix::Zero(unknowns + held, unknowns + held), right = Matrix::Zero(unknowns + held, 1);
    saddle.topLeftCorner(unknowns, unknowns) = K;
    saddle.topRightCorner(unknowns, held) = B.transpose();
    saddle.bottomLeftCorner(held, unknowns) = B;
    right.bottomRows(held) = h.cast<long double>();
    const Matrix exact = test::lu_solution(saddle, right).topRows(unknowns);
    const auto off = static_cast<double>((w.cast<long double>() - exact).cwiseAbs().maxCoeff() / exact.cwiseAbs().maxCoeff());
    EXPECT_LT(off, 2e-9) << seed;  // 3e-10 is the worst of these
  }
}

INSTANTIATE_TEST_SUITE_P(Enforcements, SolverError,
                         testing::Values(HandleEnforcement::eliminated, HandleEnforcement::soft, HandleEnforcement::multipliers));

}  // namespace
}  // namespace deform::solver_error_test
