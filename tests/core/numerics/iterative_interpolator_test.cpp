// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/iterative_interpolator.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/error.h"
#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/numerics/kernels/tiles.h"
#include "tests/core/numerics/random_points.h"

namespace deform::iterative_interpolator_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Evenly on the surface of the unit sphere (a Fibonacci lattice).
std::vector<Vec3> sphere(std::size_t count) {
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < count; ++i) {
    const double z = 1 - (2 * static_cast<double>(i) + 1) / static_cast<double>(count);
    const double r = std::sqrt(1 - z * z), angle = 2.399963229728653 * static_cast<double>(i);
    points.push_back({0.5 + 0.5 * r * std::cos(angle), 0.5 + 0.5 * r * std::sin(angle), 0.5 + 0.5 * z});
  }
  return points;
}

/// Columns: smooth, a step, noise.
MatrixXd data(const std::vector<Vec3>& points) {
  MatrixXd F(static_cast<Index>(points.size()), 3);
  const std::vector<double> noise = test::random_values(points.size(), 11);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3& p = points[i];
    F.row(static_cast<Index>(i)) << std::sin(3 * p[0]) * std::cos(2 * p[1]), p[0] > 0.6 ? 1.0 : 0.0, noise[i];
  }
  return F;
}

/// By direct summation.
double residual(const RadialKernel& kernel, const IterativeInterpolator& system, const MatrixXd& coefficients,
                const MatrixXd& F) {
  const auto m = static_cast<Index>(system.centres().size());
  const RowMajor weights = coefficients.topRows(m);
  const auto columns = static_cast<std::size_t>(F.cols());
  const std::vector<double> sums = kernel_sums(kernel, system.centres(), system.centres(),
                                               {weights.data(), static_cast<std::size_t>(weights.size())}, columns, {});
  const MatrixXd values = Eigen::Map<const RowMajor>(sums.data(), m, F.cols()) +
                          system.polynomials().matrix(system.centres()) * coefficients.bottomRows(coefficients.rows() - m);
  return (values - F).cwiseAbs().maxCoeff();
}

InterpolationOptions options(const RadialKernel& kernel) {
  InterpolationOptions options;
  options.kernel = kernel;
  return options;
}

TEST(IterativeInterpolator, InterpolatesToTheToleranceItIsGiven) {
  const std::vector<Vec3> centres = sphere(3000);
  const MatrixXd F = data(centres);
  for (const Kernel one : {Kernel::triharmonic, Kernel::biharmonic, Kernel::multiquadric}) {
    const RadialKernel kernel{one, 0.03};
    const IterativeInterpolator system(centres, options(kernel), {});
    EXPECT_GT(system.preconditioner().domains(), 4u);
    for (const double tolerance : {1e-3, 1e-6}) {
      const auto solution = system.interpolate(F, tolerance, {});
      const char* name = properties(one).name;
      EXPECT_TRUE(solution.converged) << name;
      EXPECT_LE(solution.iterations, 40) << name;
      // What is reported covers the sums' errors, as far as the samples show them.
      EXPECT_LE(solution.residual, tolerance) << name;
      EXPECT_LE(residual(kernel, system, solution.coefficients, F), 1.5 * tolerance) << name;
      const MatrixXd side = system.polynomials().matrix(centres).transpose() * solution.coefficients.topRows(F.rows());
      EXPECT_LE(side.cwiseAbs().maxCoeff(), 1e-11 * solution.coefficients.cwiseAbs().sum()) << name;
    }
  }
}

TEST(IterativeInterpolator, AgreesWithCholesky) {
  const std::vector<Vec3> centres = sphere(2500);
  const MatrixXd F = data(centres).leftCols(1);
  const DenseInterpolator exact(centres, {}, {});
  InterpolationOptions options;
  options.solver = Solver::iterative;
  const auto iterative = make_interpolator(centres, options, {});
  EXPECT_EQ(iterative->solver(), Solver::iterative);
  const std::vector<Vec3> points = test::random_points(500, 3);
  const Interpolants a = exact.interpolate(F, 1e-9), b = iterative->interpolate(F, 1e-9);
  EXPECT_TRUE(b.converged);
  const std::vector<double> u = exact.values(a, points), v = iterative->values(b, points);
  for (std::size_t i = 0; i < u.size(); ++i) EXPECT_NEAR(u[i], v[i], 1e-8) << i;
}

TEST(IterativeInterpolator, RightHandSidesOfTheSideConditionsCount) {
  // The adjoint needs P^T w = g.
  const std::vector<Vec3> centres = sphere(1500);
  const DenseInterpolator exact(centres, {}, {});
  MatrixXd B = MatrixXd::Zero(1504, 1);
  B.topRows(1500) = data(centres).leftCols(1);
  B.bottomRows(4) << 0.3, -0.2, 0.7, 0.1;
  const IterativeInterpolator iterative(centres, {}, {});
  const MatrixXd expected = exact.solve_saddle(B).coefficients;
  const MatrixXd solution = iterative.solve_saddle(B, 1e-10, {}).coefficients;
  // Compared where it matters: in the values of the interpolants.
  const auto values = [&](const MatrixXd& X) {
    Interpolants interpolants;
    interpolants.coefficients = X;
    return exact.values(interpolants, centres);
  };
  const std::vector<double> u = values(expected), v = values(solution);
  for (std::size_t i = 0; i < u.size(); ++i) ASSERT_NEAR(u[i], v[i], 1e-8) << i;
  const MatrixXd P = exact.polynomials().matrix(centres);
  EXPECT_LE((P.transpose() * solution.topRows(P.rows()) - B.bottomRows(4)).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_LE((iterative.adjoint(B) - exact.adjoint(B)).cwiseAbs().maxCoeff(), 1e-6 * exact.adjoint(B).cwiseAbs().maxCoeff());
}

TEST(IterativeInterpolator, CentresInAPlaneAndOnALine) {
  for (int dimension = 1; dimension <= 2; ++dimension) {
    std::vector<Vec3> centres = test::random_points(1500, 2);
    for (Vec3& p : centres) {
      p[2] = 0.25;
      if (dimension == 1) p[1] = 0.5 * p[0];
    }
    const RadialKernel kernel{Kernel::triharmonic, 1};
    const IterativeInterpolator system(centres, options(kernel), {});
    EXPECT_EQ(system.polynomials().hull_dimension(), dimension);
    MatrixXd F(1500, 1);
    for (std::size_t i = 0; i < centres.size(); ++i) F(static_cast<Index>(i), 0) = std::sin(5 * centres[i][0]) + centres[i][1];
    const auto solution = system.interpolate(F, 1e-6, {});
    EXPECT_TRUE(solution.converged) << dimension << ' ' << solution.residual;
    EXPECT_LE(residual(kernel, system, solution.coefficients, F), 1.5e-6) << dimension;
  }
}

TEST(IterativeInterpolator, NearlyCoincidentCentres) {
  std::vector<Vec3> centres = sphere(1200);
  for (std::size_t i = 0; i < 60; ++i) {
    centres.push_back(centres[20 * i]);
    centres.back()[0] += 1e-6;
  }
  const RadialKernel kernel{Kernel::triharmonic, 1};
  const IterativeInterpolator system(centres, options(kernel), {});
  MatrixXd F(static_cast<Index>(centres.size()), 1);
  for (std::size_t i = 0; i < centres.size(); ++i) F(static_cast<Index>(i), 0) = std::sin(5 * centres[i][0]) + centres[i][1];
  const auto solution = system.interpolate(F, 1e-6, {});
  EXPECT_TRUE(solution.converged) << solution.residual;
  EXPECT_LE(residual(kernel, system, solution.coefficients, F), 1.5e-6);
}

// Every domain by itself knows nothing of those far away: it takes five iterations without the coarse problem.
TEST(IterativeInterpolator, ACoarseProblemLeavesFewIterations) {
  const std::vector<Vec3> centres = sphere(2000);
  const RadialKernel kernel{Kernel::biharmonic, 1};
  const IterativeInterpolator system(centres, options(kernel), {});
  EXPECT_GT(system.preconditioner().domains(), 4u);
  const MatrixXd F = data(centres);
  const auto solution = system.interpolate(F, 1e-6, {});
  EXPECT_TRUE(solution.converged);
  EXPECT_LE(solution.iterations, 2);
  EXPECT_LE(residual(kernel, system, solution.coefficients, F), 1.5e-6);
}

TEST(IterativeInterpolator, AFewCentresAreSolvedAtOnce) {
  for (const std::size_t count : {std::size_t{1}, std::size_t{2}, std::size_t{5}, std::size_t{60}}) {
    const std::vector<Vec3> centres = test::random_points(count, 4);
    const RadialKernel kernel{Kernel::triharmonic, 1};
    const IterativeInterpolator system(centres, options(kernel), {});
    const MatrixXd F = data(centres);
    const auto solution = system.interpolate(F, 1e-9, {});
    EXPECT_TRUE(solution.converged) << count;
    EXPECT_LE(solution.iterations, 2) << count;
    EXPECT_LE(residual(kernel, system, solution.coefficients, F), 1e-9) << count;
  }
}

TEST(IterativeInterpolator, NotConvergingIsAResult) {
  const std::vector<Vec3> centres = sphere(1200);
  const IterativeInterpolator system(centres, {}, {});
  const auto solution = system.interpolate(data(centres), 1e-30, {});
  EXPECT_FALSE(solution.converged);
  EXPECT_GT(solution.residual, 1e-30);
  EXPECT_LT(solution.residual, 1e-6);
}

// The second round leaves the rounding errors of large weights, and the third one converges.
TEST(IterativeInterpolator, AShortRoundThatDoesNotHalveTheResidualIsNotTheEnd) {
  struct Case {
    RadialKernel kernel;
    std::size_t count;
    double tolerance;
  };
  for (const Case& one : {Case{{Kernel::multiquadric, 0.6}, 600, 1e-6}, Case{{Kernel::triharmonic, 1}, 1500, 1e-9},
                          Case{{Kernel::multiquadric, 0.2}, 1500, 1e-9}}) {
    const std::vector<Vec3> centres = test::random_points(one.count, 2);
    const IterativeInterpolator system(centres, options(one.kernel), {});
    const auto solution = system.interpolate(data(centres), one.tolerance, {});
    EXPECT_TRUE(solution.converged) << one.count << ": " << solution.residual;
    EXPECT_LE(solution.iterations, 6) << one.count;
  }
}

TEST(IterativeInterpolator, GivesUpAfterALongRoundThatDoesNotHelp) {
  const std::vector<Vec3> centres = test::random_points(1500, 2);
  const IterativeInterpolator system(centres, options({Kernel::multiquadric, 0.2}), {});
  const auto solution = system.interpolate(data(centres), 1e-14, {});
  EXPECT_FALSE(solution.converged);
  EXPECT_LE(solution.iterations, 20);
}

// Much more is left of the last column, noise, than of the first, which is smooth.
TEST(IterativeInterpolator, TellsWhatIsLeftOfEachColumn) {
  const std::vector<Vec3> centres = sphere(1200);
  const IterativeInterpolator system(centres, {}, {});
  const MatrixXd F = data(centres);
  const auto solution = system.interpolate(F, 1e-3, {});
  ASSERT_EQ(solution.residuals.size(), 3);
  for (Index c = 0; c < 3; ++c) {
    const MatrixXd column = solution.coefficients.col(c);
    const double left = residual({Kernel::triharmonic, 1}, system, column, F.col(c));
    EXPECT_GE(solution.residuals[c], 0.7 * left) << c;
    EXPECT_LE(solution.residuals[c], 3 * left + 1e-12) << c;
  }
  EXPECT_GT(solution.residuals[2], 3 * solution.residuals[0]);
  EXPECT_EQ(solution.residuals.maxCoeff(), solution.residual);
}

TEST(IterativeInterpolator, ThreadsDoNotMatter) {
  const std::vector<Vec3> centres = sphere(2000);
  RunContext one;
  one.threads = 1;
  const IterativeInterpolator a(centres, {}, {}), b(centres, {}, one);
  const MatrixXd F = data(centres);
  EXPECT_EQ(a.interpolate(F, 1e-6, {}).coefficients, b.interpolate(F, 1e-6, one).coefficients);
}

TEST(IterativeInterpolator, RefusesWendlandAndCanBeCancelled) {
  const std::vector<Vec3> centres = sphere(1000);
  EXPECT_THROW(IterativeInterpolator(centres, options({Kernel::wendland_c2, 0.5}), {}), Error);
  const IterativeInterpolator system(centres, {}, {});
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  EXPECT_THROW(system.interpolate(data(centres), 1e-6, context), Error);
}

TEST(IterativeInterpolator, MemoryIsBoundedAndLinear) {
  for (const std::size_t count : {std::size_t{500}, std::size_t{3000}, std::size_t{6000}}) {
    const IterativeInterpolator system(sphere(count), {}, {});
    EXPECT_LE(system.bytes(), IterativeInterpolator::bytes_for(count)) << count;
  }
  EXPECT_LT(IterativeInterpolator::bytes_for(200000), 2.2 * static_cast<double>(IterativeInterpolator::bytes_for(100000)));
}

TEST(ChosenSolver, IsIterativeForManyCentresOfSmoothKernels) {
  EXPECT_EQ(chosen_solver(Solver::automatic, Kernel::triharmonic, 20000), Solver::cholesky);
  EXPECT_EQ(chosen_solver(Solver::automatic, Kernel::triharmonic, 20001), Solver::iterative);
  EXPECT_EQ(chosen_solver(Solver::automatic, Kernel::wendland_c2, 30000), Solver::cholesky);
  EXPECT_EQ(chosen_solver(Solver::ldlt, Kernel::triharmonic, 30000), Solver::ldlt);
}

}  // namespace
}  // namespace deform::iterative_interpolator_test
