// Every solver of the bordered system against a dense reference, its side conditions, its failures and its condition estimate.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>
#include <thread>

#include "core/base/error.h"
#include "core/numerics/interpolation_system.h"
#include "tests/core/numerics/sample_centres.h"
#include "tests/support/expect_error.h"

namespace deform {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using test::all_kernels;
using test::distance2;
using test::random_points;

constexpr DenseSolver solvers[] = {DenseSolver::cholesky, DenseSolver::ldlt, DenseSolver::lu};

int degree_of(const RadialKernel& kernel) { return std::max(1, properties(kernel.kernel).order - 1); }

std::unique_ptr<SaddleFactor> factor(DenseSolver solver, const SaddleProblem& problem, const RunContext& context = {}) {
  if (solver == DenseSolver::cholesky) return factor_cholesky(problem, context);
  if (solver == DenseSolver::ldlt) return factor_ldlt(problem, context);
  return factor_lu(problem, context);
}

MatrixXd bordered(const SaddleProblem& problem) {
  const auto m = static_cast<Index>(problem.centres.size());
  const auto q = static_cast<Index>(problem.polynomials.terms());
  MatrixXd A = MatrixXd::Zero(m + q, m + q);
  for (Index i = 0; i < m; ++i) {
    for (Index j = 0; j < m; ++j) {
      A(i, j) = value(problem.kernel,
                      distance2(problem.centres[static_cast<std::size_t>(i)], problem.centres[static_cast<std::size_t>(j)]));
    }
  }
  const MatrixXd P = problem.polynomials.matrix(problem.centres);
  A.topRightCorner(m, q) = P;
  A.bottomLeftCorner(q, m) = P.transpose();
  return A;
}

TEST(Saddle, EverySolverAndKernelAgainstADenseReference) {
  for (const std::size_t m : {11u, 40u, 230u}) {
    const Points centres = random_points(m);
    for (const RadialKernel& kernel : all_kernels()) {
      const PolynomialSpace polynomials(centres, degree_of(kernel));
      const SaddleProblem problem{kernel, centres, polynomials};
      const MatrixXd A = bordered(problem);
      const Eigen::PartialPivLU<MatrixXd> reference(A);
      const MatrixXd B = MatrixXd::Random(A.rows(), 4);  // non-zero sums for the side conditions as well
      const MatrixXd expected = reference.solve(B);
      for (const DenseSolver solver : solvers) {
        const auto factored = factor(solver, problem);
        ASSERT_NE(factored, nullptr) << properties(kernel.kernel).name;
        MatrixXd X = B;
        factored->solve(X);
        const double size = expected.cwiseAbs().maxCoeff();
        EXPECT_LT((X - expected).cwiseAbs().maxCoeff() / size, 1e-15 * std::max(1e3, factored->condition()))
            << properties(kernel.kernel).name << " " << to_string(solver) << " m = " << m;
        EXPECT_LT((A * X - B).cwiseAbs().maxCoeff(), 1e-10 * std::max(1.0, 1e-3 * size)) << properties(kernel.kernel).name;
      }
    }
  }
}

TEST(Saddle, SideConditionsHold) {
  const Points centres = random_points(300);
  for (const RadialKernel& kernel : all_kernels()) {
    for (const DenseSolver solver : solvers) {
      InterpolationOptions options;
      options.kernel = kernel;
      options.polynomial_degree = degree_of(kernel);
      options.solver = solver;
      const InterpolationSystem system(centres, options, {});
      const MatrixXd F = MatrixXd::Random(300, 2);
      const MatrixXd W = system.solve(F).topRows(300);
      const double size = W.cwiseAbs().maxCoeff();
      for (Index c = 0; c < 2; ++c) {
        Eigen::Vector4d moments = Eigen::Vector4d::Zero();
        for (Index i = 0; i < 300; ++i) {
          const Vec3& x = centres[static_cast<std::size_t>(i)];
          moments += W(i, c) * Eigen::Vector4d(1, x[0], x[1], x[2]);
        }
        EXPECT_LT(moments.cwiseAbs().maxCoeff(), 1e-10 * std::max(1.0, size)) << properties(kernel.kernel).name;
      }
    }
  }
}

TEST(Saddle, CholeskyIsTheSameForAnyNumberOfThreads) {
  const Points centres = random_points(600);
  const PolynomialSpace polynomials(centres, 1);
  const SaddleProblem problem{{Kernel::triharmonic, 1}, centres, polynomials};
  MatrixXd results[2];
  for (const int threads : {1, 2}) {
    RunContext context;
    context.threads = threads;
    MatrixXd& B = results[threads - 1];
    B = MatrixXd::Ones(604, 3);
    B.row(5).setConstant(3);
    factor_cholesky(problem, context)->solve(B);
  }
  EXPECT_TRUE(results[0] == results[1]);
}

// 100 points and 60 more only 1e-8 away from the first ones.
Points near_duplicates() {
  Points centres = random_points(100);
  for (std::size_t i = 0; i < 60; ++i) centres.push_back({centres[i][0] + 1e-8, centres[i][1], centres[i][2]});
  return centres;
}

TEST(Saddle, NearlyCoincidentCentresFallBackToLdlt) {
  const Points centres = near_duplicates();
  InterpolationOptions options;
  const InterpolationSystem system(centres, options, {});
  EXPECT_EQ(system.solver(), DenseSolver::ldlt);
  ASSERT_EQ(system.notes().size(), 1u);
  EXPECT_THAT(system.notes()[0], testing::HasSubstr("LDL^T was used instead"));
  MatrixXd F(160, 1);
  for (std::size_t i = 0; i < 160; ++i) F(static_cast<Index>(i), 0) = std::sin(3 * centres[i][0]) * centres[i][1];
  const MatrixXd X = system.solve(F);
  const PolynomialSpace polynomials(centres, 1);
  const MatrixXd A = bordered({{Kernel::triharmonic, 1}, centres, polynomials});
  EXPECT_LT((A * X).topRows(160).cwiseAbs().maxCoeff(), 10);
  EXPECT_LT(((A * X).topRows(160) - F).cwiseAbs().maxCoeff(), 1e-7);

  options.solver = DenseSolver::cholesky;
  test::expect_error(ErrorCode::numerical_failure, {"160 centres", "not positive definite", "AUTOMATIC or LDLT"},
                     [&] { const InterpolationSystem refused(centres, options, {}); });
  options.solver = DenseSolver::automatic;
  options.memory_limit = 1000;
  test::expect_error(ErrorCode::out_of_budget, {"LDL^T needs", "available are", "nearly coincident"},
                     [&] { const InterpolationSystem refused(centres, options, {}); });
}

TEST(Saddle, CoincidentCentresAreSingular) {
  const Points centres(5, Vec3{1, 2, 3});
  InterpolationOptions options;
  for (const DenseSolver solver : {DenseSolver::automatic, DenseSolver::ldlt, DenseSolver::lu}) {
    options.solver = solver;
    test::expect_error(ErrorCode::numerical_failure, {"singular", "centres coincide"},
                       [&] { const InterpolationSystem refused(centres, options, {}); });
  }
}

double norm1(const MatrixXd& A) { return A.cwiseAbs().colwise().sum().maxCoeff(); }

TEST(Saddle, ConditionIsEstimatedWithinAFactorOfTen) {
  for (const std::size_t m : {20u, 150u, 400u}) {
    const Points centres = random_points(m);
    const PolynomialSpace polynomials(centres, 1);
    const SaddleProblem problem{{Kernel::triharmonic, 1}, centres, polynomials};
    const MatrixXd A = bordered(problem);
    const double exact = norm1(A) * norm1(A.inverse());
    for (const DenseSolver solver : {DenseSolver::ldlt, DenseSolver::lu}) {
      const double estimated = factor(solver, problem)->condition();
      EXPECT_LE(estimated, exact * 1.001);
      EXPECT_GE(estimated, exact / 10);
    }
    // The projected matrix, by the same Householder reflections.
    const auto M = static_cast<Index>(m);
    const MatrixXd Q = Eigen::HouseholderQR<MatrixXd>(polynomials.matrix(centres)).householderQ();
    const MatrixXd K = (Q.transpose() * A.topLeftCorner(M, M) * Q).bottomRightCorner(M - 4, M - 4);
    const double projected = norm1(K) * norm1(K.inverse());
    const double estimated = factor(DenseSolver::cholesky, problem)->condition();
    EXPECT_LE(estimated, projected * 1.01);
    EXPECT_GE(estimated, projected / 10);
  }
}

TEST(Saddle, UnitsLeaveTheProjectedConditionAlone) {
  Points metres = random_points(240), millimetres = metres;
  for (Vec3& p : millimetres) {
    for (double& x : p) x *= 1000;
  }
  const PolynomialSpace in_metres(metres, 1), in_millimetres(millimetres, 1);
  const double small = factor_cholesky({{Kernel::triharmonic, 1}, metres, in_metres}, {})->condition();
  const double large = factor_cholesky({{Kernel::triharmonic, 1}, millimetres, in_millimetres}, {})->condition();
  EXPECT_NEAR(large / small, 1, 1e-6);
}

TEST(Saddle, ManyThreadsSolveAtOnce) {
  const Points centres = random_points(200);
  for (const DenseSolver solver : solvers) {
    InterpolationOptions options;
    options.solver = solver;
    const InterpolationSystem system(centres, options, {});
    const MatrixXd F = MatrixXd::Random(200, 3);
    const MatrixXd expected = system.solve(F);
    std::vector<MatrixXd> results(8);
    std::vector<std::thread> threads;
    for (MatrixXd& result : results) threads.emplace_back([&] { result = system.solve(F); });
    for (std::thread& thread : threads) thread.join();
    for (const MatrixXd& result : results) EXPECT_TRUE(result == expected) << to_string(solver);
  }
}

TEST(Saddle, CancelledAndLate) {
  const Points centres = random_points(400);
  for (const DenseSolver solver : solvers) {
    InterpolationOptions options;
    options.solver = solver;
    for (const char* stage : {"assemble", "factor"}) {
      RunContext context;
      context.cancel.emplace();
      context.on_progress = [&](const std::string& now, double) {
        if (now == stage) context.cancel->cancel();
      };
      test::expect_error(ErrorCode::cancelled, {}, [&] { const InterpolationSystem stopped(centres, options, context); });
    }
    RunContext late;
    late.deadline = RunContext::Clock::now() - std::chrono::seconds(1);
    test::expect_error(ErrorCode::deadline_exceeded, {}, [&] { const InterpolationSystem stopped(centres, options, late); });
  }
}

TEST(Saddle, OneCentre) {
  InterpolationOptions options;
  for (const DenseSolver solver : solvers) {
    options.solver = solver;
    const InterpolationSystem system(Points{{1, 2, 3}}, options, {});
    const MatrixXd X = system.solve(MatrixXd::Constant(1, 1, 7));
    EXPECT_NEAR(X(0, 0), 0, 1e-15) << to_string(solver);
    EXPECT_NEAR(X(1, 0), 7, 1e-14) << to_string(solver);
  }
}

}  // namespace
}  // namespace deform
