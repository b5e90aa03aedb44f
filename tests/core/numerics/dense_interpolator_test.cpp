// SPDX-License-Identifier: GPL-3.0-or-later
// Every solver and kernel against a plain dense solve of the bordered system (thesis eq. 3.9, 3.10); breakdowns and limits.
#include "core/numerics/interpolation/dense_interpolator.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "core/numerics/interpolation/value_errors.h"
#include "tests/core/numerics/random_points.h"
#include "tests/support/expect_error.h"

namespace deform::dense_interpolator_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

MatrixXd bordered(const DenseInterpolator& system) {
  const auto& centres = system.centres();
  const auto m = static_cast<Index>(centres.size());
  const auto q = static_cast<Index>(system.polynomials().terms());
  MatrixXd A = MatrixXd::Zero(m + q, m + q);
  for (Index i = 0; i < m; ++i) {
    for (Index j = 0; j < m; ++j) {
      const double r2 = test::squared_distance(centres[static_cast<std::size_t>(i)], centres[static_cast<std::size_t>(j)]);
      A(i, j) = value(system.kernel(), r2);
    }
  }
  A.topRightCorner(m, q) = system.polynomials().matrix(centres);
  A.bottomLeftCorner(q, m) = A.topRightCorner(m, q).transpose();
  return A;
}

MatrixXd random_matrix(Index rows, Index columns, std::uint64_t seed) {
  const auto values = test::random_values(static_cast<std::size_t>(rows * columns), seed);
  return Eigen::Map<const MatrixXd>(values.data(), rows, columns);
}

// A smooth field, as deformations are.
MatrixXd smooth_values(const std::vector<Vec3>& points) {
  MatrixXd F(points.size(), 3);
  for (Index i = 0; i < F.rows(); ++i) {
    const Vec3& x = points[static_cast<std::size_t>(i)];
    F.row(i) << std::sin(3 * x[0]) + x[1], std::cos(2 * x[1] - x[2]), x[0] * x[1] * x[2];
  }
  return F;
}

int degree_for(const RadialKernel& kernel) { return std::max(1, properties(kernel.kernel).order - 1); }

DenseInterpolator make(const std::vector<Vec3>& centres, const RadialKernel& kernel, Solver solver,
                       const RunContext& context = {}) {
  InterpolationOptions options;
  options.kernel = kernel;
  options.polynomial_degree = degree_for(kernel);
  options.solver = solver;
  return DenseInterpolator(centres, options, context);
}

constexpr Solver solvers[] = {Solver::automatic, Solver::cholesky, Solver::ldlt};

TEST(DenseInterpolator, EverySolverAndKernelEqualsADenseSolve) {
  const auto centres = test::random_points(211, 1);
  for (const RadialKernel& kernel : test::all_kernels()) {
    for (const Solver solver : solvers) {
      SCOPED_TRACE(std::string(properties(kernel.kernel).name) + " " + to_string(solver));
      const DenseInterpolator system = make(centres, kernel, solver);
      EXPECT_EQ(system.solver(), solver == Solver::automatic ? Solver::cholesky : solver);
      const MatrixXd A = bordered(system);
      // Both parts of the right-hand side, as adjoints need them.
      const MatrixXd B = random_matrix(A.rows(), 4, 2);
      const MatrixXd X = system.solve_saddle(B).coefficients;
      const MatrixXd expected = A.fullPivLu().solve(B);
      const double limit = 1e-14 * (A.cwiseAbs().colwise().sum().maxCoeff() * A.inverse().cwiseAbs().colwise().sum().maxCoeff());
      EXPECT_LT((X - expected).norm(), std::max(1e-11, limit) * expected.norm());
      EXPECT_LT((A * X - B).norm(), 1e-12 * (A.norm() * X.norm()));

      const MatrixXd F = smooth_values(centres);
      const MatrixXd W = system.interpolate(F, 0).coefficients;
      const auto m = static_cast<Index>(centres.size());
      EXPECT_LT((A.topRows(m) * W - F).cwiseAbs().maxCoeff(), 1e-10);
      // Side conditions: the weights carry no polynomial (thesis eq. 3.9).
      EXPECT_LT((A.bottomLeftCorner(A.rows() - m, m) * W.topRows(m)).cwiseAbs().maxCoeff(),
                1e-10 * std::max(1.0, W.topRows(m).cwiseAbs().maxCoeff()));
    }
  }
}

TEST(DenseInterpolator, CentresOnPlanesLinesAndPoints) {
  for (const int dimension : {0, 1, 2}) {
    auto centres = test::random_points(dimension == 0 ? 1 : 90, 4);
    for (Vec3& c : centres) c = {0.2 + 0.8 * c[0], dimension > 1 ? c[1] : 0.5, 0.3 + 0.25 * c[0]};
    for (const Solver solver : solvers) {
      const DenseInterpolator system = make(centres, {}, solver);
      EXPECT_EQ(system.polynomials().hull_dimension(), dimension);
      const MatrixXd F = smooth_values(centres);
      const MatrixXd W = system.interpolate(F, 0).coefficients;
      EXPECT_LT((bordered(system).topRows(F.rows()) * W - F).cwiseAbs().maxCoeff(), 1e-9) << dimension << to_string(solver);
    }
  }
}

TEST(DenseInterpolator, QuinticOnASphere) {
  auto centres = test::random_points(150, 6);
  for (Vec3& c : centres) {
    const Vec3 d{c[0] - 0.5, c[1] - 0.5, c[2] - 0.5};
    for (std::size_t k = 0; k < 3; ++k) c[k] = 0.5 + 0.5 * d[k] / std::hypot(d[0], d[1], d[2]);
  }
  const DenseInterpolator system = make(centres, {Kernel::quintic, 1}, Solver::automatic);
  EXPECT_EQ(system.solver(), Solver::cholesky);
  EXPECT_EQ(system.polynomials().terms(), 9u);
  const MatrixXd F = smooth_values(centres);
  EXPECT_LT((bordered(system).topRows(150) * system.interpolate(F, 0).coefficients - F).cwiseAbs().maxCoeff(), 1e-9);
}

// 60 pairs 1e-8 apart stop Cholesky, while LDL^T of differences still delivers.
std::vector<Vec3> pairs() {
  auto centres = test::random_points(300, 8);
  for (std::size_t i = 0; i < 60; ++i) centres.push_back({centres[i][0] + 1e-8, centres[i][1], centres[i][2]});
  return centres;
}

TEST(DenseInterpolator, NearlyCoincidentCentresFallBackToLdlt) {
  const auto centres = pairs();
  const DenseInterpolator system = make(centres, {}, Solver::automatic);
  EXPECT_EQ(system.solver(), Solver::ldlt);
  ASSERT_EQ(system.notes().size(), 1u);
  EXPECT_THAT(system.notes()[0], testing::HasSubstr("Cholesky broke down"));
  const MatrixXd F = smooth_values(centres);
  const MatrixXd A = bordered(system), W = system.interpolate(F, 0).coefficients;
  EXPECT_LT((A.topRows(360) * W - F).norm(), 1e-14 * A.norm() * W.norm());
  // Values are 2 at most. Measured 3e-7 here and 4e-8 on another set: the matrix is singular to working precision.
  EXPECT_LT((A.topRows(360) * W - F).cwiseAbs().maxCoeff(), 1e-6);
  for (const Index count : {301, 302, 305}) {  // one pair is enough
    const DenseInterpolator few = make({centres.begin(), centres.begin() + count}, {}, Solver::automatic);
    EXPECT_EQ(few.solver(), Solver::ldlt);
    EXPECT_LT((bordered(few).topRows(count) * few.interpolate(F.topRows(count), 0).coefficients - F.topRows(count))
                  .cwiseAbs()
                  .maxCoeff(),
              1e-7);
  }

  test::expect_error(ErrorCode::numerical_failure, {"not positive definite", "AUTOMATIC or LDLT"},
                     [&] { make(centres, {}, Solver::cholesky); });
  InterpolationOptions tight;
  tight.memory_limit = 1000;
  test::expect_error(ErrorCode::out_of_budget, {"LDL^T needs", "available"},
                     [&] { DenseInterpolator(centres, tight, RunContext{}); });
}

// Columns of a boundary layer: Cholesky goes through, but refinement does not converge with its factor.
TEST(DenseInterpolator, ThinLayersFallBackToLdlt) {
  for (const auto& [columns, first, layers] : {std::tuple{60u, 2e-5, 6}, std::tuple{150u, 3e-5, 3}}) {
    std::vector<Vec3> centres;
    for (const Vec3& x : test::random_points(columns, 8)) {
      for (int layer = 0; layer < layers; ++layer) centres.push_back({x[0], x[1], first * (std::pow(1.3, layer) - 1) / 0.3});
    }
    const MatrixXd F = smooth_values(centres);
    const DenseInterpolator cholesky = make(centres, {}, Solver::cholesky), system = make(centres, {}, Solver::automatic);
    ASSERT_FALSE(cholesky.interpolate(F, 0).converged) << cholesky.condition();
    EXPECT_EQ(system.solver(), Solver::ldlt);
    ASSERT_EQ(system.notes().size(), 1u);
    EXPECT_THAT(system.notes()[0], testing::HasSubstr("hardly a correct digit"));
    const Interpolants found = system.interpolate(F, 0);
    EXPECT_TRUE(found.converged);
    EXPECT_LT((bordered(system).topRows(F.rows()) * found.coefficients - F).cwiseAbs().maxCoeff(), 1e-9);
    InterpolationOptions tight;
    tight.memory_limit = 1000;  // rather than nothing
    EXPECT_EQ(DenseInterpolator(centres, tight, RunContext{}).solver(), Solver::cholesky);
  }
}

TEST(DenseInterpolator, ConditionEstimateIsNearTheTruth) {
  const auto centres = test::random_points(160, 9);
  for (const RadialKernel& kernel : test::all_kernels()) {
    {
      const DenseInterpolator system = make(centres, kernel, Solver::ldlt);
      const MatrixXd A = bordered(system);
      const double truth =
          A.cwiseAbs().colwise().sum().maxCoeff() * A.fullPivLu().inverse().cwiseAbs().colwise().sum().maxCoeff();
      EXPECT_LT(system.condition(), truth * 1.01) << properties(kernel.kernel).name;
      EXPECT_GT(system.condition(), truth / 4) << properties(kernel.kernel).name;
    }
    EXPECT_GT(make(centres, kernel, Solver::cholesky).condition(), 1.0);
  }
}

TEST(DenseInterpolator, ProjectionImprovesTheConditionUnderUnitChange) {
  auto centres = test::random_points(240, 10);
  for (Vec3& c : centres) {
    for (double& x : c) x *= 1000;  // metres to millimetres, without the unit box
  }
  const DenseInterpolator projected = make(centres, {}, Solver::cholesky);
  const double bordered_condition = factor_ldlt({projected.kernel(), centres, projected.polynomials()}, {})->condition();
  const double projected_condition = projected.condition();
  EXPECT_GT(bordered_condition, 1e12);
  EXPECT_LT(projected_condition, 1e7);
}

TEST(DenseInterpolator, SameBitsForAnyNumberOfThreads) {
  const auto centres = test::random_points(700, 11);
  const MatrixXd F = random_matrix(700, 3, 12);
  for (const Solver solver : solvers) {
    RunContext context;
    context.threads = 1;
    const MatrixXd one = make(centres, {}, solver, context).interpolate(F, 0).coefficients;
    context.threads = 2;
    const MatrixXd two = make(centres, {}, solver, context).interpolate(F, 0).coefficients;
    EXPECT_TRUE(one == two) << to_string(solver);
  }
}

TEST(DenseInterpolator, SolvesFromManyThreads) {
  const auto centres = test::random_points(300, 13);
  const MatrixXd F = random_matrix(300, 3, 14);
  for (const Solver solver : solvers) {
    const DenseInterpolator system = make(centres, {}, solver);
    const MatrixXd expected = system.interpolate(F, 0).coefficients;
    std::vector<MatrixXd> got(4);
    std::vector<std::thread> threads;
    for (auto& W : got) {
      threads.emplace_back([&] { W = system.interpolate(F, 0).coefficients; });
    }
    for (auto& thread : threads) thread.join();
    for (const auto& W : got) EXPECT_TRUE(W == expected) << to_string(solver);
  }
}

TEST(DenseInterpolator, BytesStayWithinTheirBounds) {
  for (const std::size_t m : {5, 100, 700}) {
    for (const Solver solver : solvers) {
      const DenseInterpolator system = make(test::random_points(m, 15), {}, solver);
      EXPECT_LE(system.bytes(), DenseInterpolator::bytes_for(m, solver) + m * sizeof(Vec3)) << m << to_string(solver);
    }
  }
}

TEST(DenseInterpolator, StopsWhenCancelledBeforeAndDuring) {
  const auto centres = test::random_points(900, 16);
  RunContext before;
  std::stop_source stop;
  before.stop = stop.get_token();
  stop.request_stop();
  for (const Solver solver : solvers) {
    test::expect_error(ErrorCode::cancelled, {}, [&] { make(centres, {}, solver, before); });
    for (const char* stage : {"assemble", "factor"}) {
      RunContext during;
      std::stop_source stop_during;
      during.stop = stop_during.get_token();
      during.on_progress = [&](const std::string& now, double) {
        if (now == stage) stop_during.request_stop();
      };
      test::expect_error(ErrorCode::cancelled, {}, [&] { make(centres, {}, solver, during); });
    }
  }
}

TEST(DenseInterpolator, TellsHowFarEachStageIs) {
  for (const Solver solver : solvers) {
    std::map<std::string, std::vector<double>> told;
    RunContext context;
    context.threads = 1;
    context.on_progress = [&](const std::string& stage, double fraction) { told[stage].push_back(fraction); };
    make(test::random_points(300, 21), {}, solver, context);
    EXPECT_EQ(told.count("factor"), 1u) << to_string(solver);
    for (const auto& [stage, fractions] : told) {
      EXPECT_TRUE(std::is_sorted(fractions.begin(), fractions.end())) << to_string(solver) << stage;
      EXPECT_GE(fractions.front(), 0) << to_string(solver) << stage;
      EXPECT_EQ(fractions.back(), 1) << to_string(solver) << stage;
    }
  }
}

TEST(DenseInterpolator, OneCentreAndCoincidentOnes) {
  for (const Solver solver : solvers) {
    const DenseInterpolator system = make({{1, 2, 3}}, {}, solver);
    const MatrixXd X = system.interpolate(MatrixXd::Constant(1, 1, 7), 0).coefficients;
    EXPECT_NEAR(X(0, 0), 0, 1e-15) << to_string(solver);
    EXPECT_NEAR(X(1, 0), 7, 1e-14) << to_string(solver);
    if (solver == Solver::cholesky) continue;
    test::expect_error(ErrorCode::numerical_failure, {"singular", "centres coincide"}, [&] {
      make(std::vector<Vec3>(5, Vec3{1, 2, 3}), {}, solver);
    });
  }
}

TEST(Interpolator, BytesAreEstimatedForEverySolver) {
  constexpr std::size_t m = 700;
  for (const Solver solver : {Solver::cholesky, Solver::ldlt, Solver::iterative, Solver::incremental_qr}) {
    SCOPED_TRACE(to_string(solver));
    InterpolationOptions options;
    options.solver = solver;
    const auto system = make_interpolator(test::random_points(m, 38), options, {});
    EXPECT_EQ(system->solver(), solver);
    EXPECT_LE(system->bytes(), interpolator_bytes(m, solver) + m * sizeof(Vec3));
    EXPECT_GE(2 * system->bytes(), interpolator_bytes(m, solver));
    EXPECT_GT(interpolator_peak_bytes(m, solver), system->bytes());
  }
}

// The largest sum of absolute terms is that of one of three columns, at one of the places: of weights, or of the polynomial.
TEST(Interpolator, RoundingIsThatOfTheLargestTerms) {
  const auto centres = test::random_points(50, 34), points = test::random_points(8, 35);
  const DenseInterpolator system(centres, {}, {});
  const MatrixXd P = system.polynomials().matrix(points);
  for (Eigen::Index large = 0; large < 3; ++large) {
    for (const double size : {1e3, 1e-3}) {  // of weights, beside polynomials of 1
      Interpolants interpolants;
      const auto weights = test::random_values(50 * 3, 36), rest = test::random_values(4 * 3, 37);
      interpolants.coefficients.resize(54, 3);
      interpolants.coefficients.topRows(50) = size * Eigen::Map<const MatrixXd>(weights.data(), 50, 3);
      interpolants.coefficients.bottomRows(4) = Eigen::Map<const MatrixXd>(rest.data(), 4, 3);
      interpolants.coefficients.col(large) *= 10;
      double largest = 0;
      for (Eigen::Index i = 0; i < 8; ++i) {
        for (Eigen::Index c = 0; c < 3; ++c) {
          double kernels = 0;
          for (Eigen::Index j = 0; j < 50; ++j) {
            const double r =
                std::sqrt(test::squared_distance(points[static_cast<std::size_t>(i)], centres[static_cast<std::size_t>(j)]));
            kernels += r * r * r * std::abs(interpolants.coefficients(j, c));
          }
          const double terms = P.row(i).cwiseAbs().dot(interpolants.coefficients.col(c).tail(4).cwiseAbs());
          largest = std::max({largest, kernels, terms});
        }
      }
      const double expected = std::numeric_limits<double>::epsilon() / 2 * largest;
      EXPECT_NEAR(system.rounding(interpolants, points), expected, 1e-12 * expected) << large << " " << size;
    }
  }
}

// Values that are off by a known amount, coefficients that are uncertain by a known share of themselves, and no value at all.
TEST(ValueErrors, AreDifferencesUncertaintyAndRounding) {
  const auto centres = test::random_points(60, 31), points = test::random_points(10, 32);
  const auto given = test::random_values(60 * 2, 33);
  const DenseInterpolator system(centres, {}, {});
  Interpolants interpolants = system.interpolate(Eigen::Map<const MatrixXd>(given.data(), 60, 2), 0);
  interpolants.uncertainty.resize(0, 0);
  const std::vector<double> sums = system.direct_values(interpolants, points);
  MatrixXd values(10, 2);
  for (Eigen::Index i = 0; i < 10; ++i) {
    for (Eigen::Index c = 0; c < 2; ++c) values(i, c) = sums[static_cast<std::size_t>(2 * i + c)];
  }
  const MatrixXd rounding = value_errors(system, interpolants, points, values, {});
  for (Eigen::Index i = 0; i < 10; ++i) {
    for (Eigen::Index c = 0; c < 2; ++c) {
      EXPECT_GE(rounding(i, c), 1e-16 * std::abs(values(i, c)));
      EXPECT_LE(rounding(i, c), 1e-12);
    }
  }
  interpolants.uncertainty = 1e-8 * interpolants.coefficients;
  const MatrixXd uncertain = value_errors(system, interpolants, points, values, {});
  EXPECT_LT((uncertain - rounding - 1e-8 * values.cwiseAbs()).cwiseAbs().maxCoeff(), 1e-15);
  MatrixXd off = values;
  off(3, 1) += 1e-6;
  off(4, 0) = std::nan("");
  const MatrixXd wrong = value_errors(system, interpolants, points, off, {});
  EXPECT_NEAR(wrong(3, 1), uncertain(3, 1) + 1e-6, 1e-12);
  EXPECT_EQ(wrong(4, 0), std::numeric_limits<double>::infinity());
  EXPECT_EQ(wrong(4, 1), uncertain(4, 1));
}

}  // namespace
}  // namespace deform::dense_interpolator_test
