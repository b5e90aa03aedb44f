// SPDX-License-Identifier: GPL-3.0-or-later
// The global step against dense matrices in which the distances of sets that move with their points are taken from their means.
#include "core/deformers/constrained/global_step.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <random>

#include "core/constraints/constraint.h"
#include "tests/support/linear_algebra.h"

namespace deform::global_step_test {
namespace {

constexpr std::int64_t functions = 24, points = 60;

double random_value(std::mt19937& random) { return std::uniform_real_distribution<double>(-1, 1)(random); }

/// Positive definite, tridiagonal.
SparseMatrix chain(std::mt19937& random) {
  SparseMatrix result(functions, functions);
  for (std::int64_t i = 0; i < functions; ++i) {
    result.insert(i, i) = 3 + random_value(random);
    if (i > 0) result.insert(i, i - 1) = random_value(random);
  }
  SparseMatrix lower = result.triangularView<Eigen::Lower>();
  lower.makeCompressed();
  return lower;
}

/// Three neighbouring functions at each point.
SparseRows values_at_points(std::mt19937& random) {
  SparseRows result(points, functions);
  for (std::int64_t i = 0; i < points; ++i) {
    const std::int64_t first = i * (functions - 3) / points;
    for (std::int64_t j = first; j < first + 3; ++j) result.insert(i, j) = random_value(random);
  }
  result.makeCompressed();
  return result;
}

ConstraintSet set_of(const ConstraintKind& kind, PointId first, PointId end, double weight, std::mt19937& random) {
  ConstraintSet set;
  for (PointId id = first; id < end; ++id) {
    set.ids.push_back(id);
    set.rest.push_back({random_value(random), random_value(random), random_value(random)});
  }
  const std::vector<std::vector<Vec3>> regions{set.rest};
  set.projection = make_projection(kind, regions, {});
  set.weight = weight;
  return set;
}

/// Minimum of  v^T S v - 2 v^T top + sum over sets of weight / n |C (Phi v - y)|^2,  where C takes from the means what moves.
Eigen::MatrixXd reference(const SparseMatrix& energy, const SparseRows& values, const std::vector<ConstraintSet>& sets,
                          const Eigen::MatrixXd& top, const std::vector<Vec3>& targets) {
  const Eigen::MatrixXd lower(energy);
  Eigen::MatrixXd A = lower.selfadjointView<Eigen::Lower>(), b = top;
  std::size_t next = 0;
  for (const ConstraintSet& set : sets) {
    const auto n = static_cast<Eigen::Index>(set.ids.size());
    Eigen::MatrixXd phi(n, functions), y(n, 3), C = Eigen::MatrixXd::Identity(n, n);
    for (Eigen::Index i = 0; i < n; ++i) {
      phi.row(i) = Eigen::MatrixXd(values).row(static_cast<Eigen::Index>(set.ids[static_cast<std::size_t>(i)]));
      for (Eigen::Index k = 0; k < 3; ++k) y(i, k) = targets[next][static_cast<std::size_t>(k)];
      ++next;
    }
    if (set.projection->moves_with_its_points()) C.array() -= 1.0 / static_cast<double>(n);
    const double weight = set.weight / static_cast<double>(n);
    A += weight * phi.transpose() * C * phi;
    b += weight * phi.transpose() * C * y;
  }
  return test::full_lu_solution(A, b);
}

TEST(GlobalStep, IsTheMinimumOverTheTranslationsOfTheSets) {
  for (std::uint32_t seed = 0; seed < 10; ++seed) {
    std::mt19937 random(seed);
    EnergySolver::Problem problem;
    problem.energy = chain(random);
    problem.coupling = SparseMatrix(functions, 0);
    const EnergySolver solver(problem, 0, {});
    const SparseRows values = values_at_points(random);
    // The first two have points in common; the last plane stays where it is.
    const std::vector<ConstraintSet> sets{set_of(Planar{}, 3, 22, 40, random), set_of(Rigid{}, 15, 30, 7, random),
                                          set_of(FixedPlane{{0, 0, 0}, {0, 0, 1}}, 40, 52, 11, random)};
    const ReducedEnergy energy(solver, functions_reaching(values, sets), 0, {});
    const ConstrainedPoints constrained(sets, values, energy);
    ASSERT_EQ(energy.size(), static_cast<std::size_t>(functions)) << "all, so that the energy is that of the problem";
    const GlobalStep step(constrained, energy, 0, {});
    const Eigen::MatrixXd top = Eigen::MatrixXd::NullaryExpr(functions, 3, [&] { return random_value(random); });
    std::vector<Vec3> targets(constrained.count());
    for (Vec3& y : targets) y = {5 + random_value(random), random_value(random), random_value(random)};
    const Eigen::MatrixXd expected = reference(problem.energy, values, sets, top, targets);
    EXPECT_LE((step.solve(top, targets, {}) - expected).norm(), 1e-11 * expected.norm()) << seed;
    const Eigen::MatrixXd without = reference(problem.energy, values, sets, Eigen::MatrixXd::Zero(functions, 3), targets);
    EXPECT_LE((step.solve({}, targets, {}) - without).norm(), 1e-11 * without.norm()) << seed;
  }
}

}  // namespace
}  // namespace deform::global_step_test
