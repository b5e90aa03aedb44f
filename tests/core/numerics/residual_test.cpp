// SPDX-License-Identifier: GPL-3.0-or-later
// Double-double residuals against long double, and what refinement with them does for an ill-conditioned system.
#include "core/numerics/kernels/residual.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stop_token>
#include <vector>

#include "core/numerics/interpolation/dense_interpolator.h"
#include "tests/core/numerics/every_target.h"
#include "tests/core/numerics/random_points.h"
#include "tests/support/expect_error.h"

namespace deform::residual_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Long = long double;
using MatrixXl = Eigen::Matrix<Long, Eigen::Dynamic, Eigen::Dynamic>;

Long long_value(const RadialKernel& kernel, Long r2) {
  const Long r = std::sqrt(r2);
  switch (kernel.kernel) {
    case Kernel::triharmonic:
      return r2 * r;
    case Kernel::biharmonic:
      return r;
    case Kernel::quintic:
      return r2 * r2 * r;
    case Kernel::gaussian:
      return std::exp(r2 * Long(-1 / (kernel.shape * kernel.shape)));
    case Kernel::multiquadric:
      return std::sqrt(r2 + Long(kernel.shape * kernel.shape));
    case Kernel::inverse_multiquadric:
      return 1 / std::sqrt(r2 + Long(kernel.shape * kernel.shape));
    case Kernel::thin_plate:
      return r2 > 0 ? r2 * std::log(r2) / 2 : 0;
    case Kernel::wendland_c2:
      break;
  }
  const Long q = r * Long(1 / kernel.shape), t = std::max(Long(0), 1 - q);
  return t * t * t * t * (4 * q + 1);
}

MatrixXl long_matrix(const RadialKernel& kernel, const std::vector<Vec3>& centres, const MatrixXd& P) {
  const auto m = static_cast<Index>(centres.size()), q = P.cols();
  MatrixXl A = MatrixXl::Zero(m + q, m + q);
  for (Index i = 0; i < m; ++i) {
    for (Index j = 0; j < m; ++j) {
      Long r2 = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        const Long d = Long(centres[static_cast<std::size_t>(i)][k]) - Long(centres[static_cast<std::size_t>(j)][k]);
        r2 += d * d;
      }
      A(i, j) = long_value(kernel, r2);
    }
  }
  A.topRightCorner(m, q) = P.cast<Long>();
  A.bottomLeftCorner(q, m) = P.cast<Long>().transpose();
  return A;
}

// Columns of a closed form plus a tiny difference, so that plain doubles would lose every digit of the residual.
TEST(Residual, HasItsDigitsWhereDoublesCancel) {
  const auto centres = test::random_points(75, 1);
  const MatrixXd P = PolynomialSpace(centres, 1).matrix(centres);
  const auto values = test::random_values((75 + 4) * 5, 2);
  const MatrixXd X = 1000 * Eigen::Map<const MatrixXd>(values.data(), 75 + 4, 5);
  for (const RadialKernel& kernel : test::all_kernels()) {
    const MatrixXl product = long_matrix(kernel, centres, P).topRows(75) * X.cast<Long>();
    const MatrixXd F = product.cast<double>();
    const MatrixXd expected = (F.cast<Long>() - product).cast<double>();
    test::on_every_target([&] {
      const MatrixXd got = accurate_residual(kernel, centres, centres, P, X, F, {});
      // long double itself has 64 bits.
      constexpr double limit = 20 * 1e-19 * 75 * 1000;
      EXPECT_LT((got - expected).cwiseAbs().maxCoeff(), limit) << properties(kernel.kernel).name;
    });
    EXPECT_GT(expected.cwiseAbs().maxCoeff(), 0);
  }
}

TEST(Residual, RootSquareSumsAreThoseOfTheTerms) {
  const auto centres = test::random_points(40, 6), points = test::random_points(9, 7);
  const auto values = test::random_values((40 + 4) * 2, 8);
  const MatrixXd W =
      Eigen::Map<const MatrixXd>(values.data(), 40 + 4, 2);  // with the coefficients of a polynomial, which do not count
  for (const RadialKernel& kernel : test::all_kernels()) {
    const MatrixXd got = root_square_sums(kernel, points, centres, W, {});
    ASSERT_EQ(got.rows(), 9);
    ASSERT_EQ(got.cols(), 2);
    for (Index i = 0; i < 9; ++i) {
      for (Index c = 0; c < 2; ++c) {
        Long sum = 0;
        for (Index j = 0; j < 40; ++j) {
          const double square = test::squared_distance(points[static_cast<std::size_t>(i)], centres[static_cast<std::size_t>(j)]);
          const Long term = long_value(kernel, square) * W(j, c);
          sum += term * term;
        }
        EXPECT_NEAR(got(i, c), static_cast<double>(std::sqrt(sum)), 1e-13) << properties(kernel.kernel).name;
      }
    }
  }
  std::stop_source stop;
  stop.request_stop();
  RunContext cancelled;
  cancelled.stop = stop.get_token();
  test::expect_error(ErrorCode::cancelled, {}, [&] { root_square_sums({}, points, centres, W, cancelled); });
}

TEST(Residual, SameBitsForAnyNumberOfThreads) {
  const auto centres = test::random_points(333, 3);
  const MatrixXd P = PolynomialSpace(centres, 1).matrix(centres);
  const auto values = test::random_values((333 + 4) * 3, 4);
  const MatrixXd X = Eigen::Map<const MatrixXd>(values.data(), 333 + 4, 3);
  const MatrixXd F = X.topRows(333);
  RunContext one;
  one.threads = 1;
  EXPECT_EQ(accurate_residual({}, centres, centres, P, X, F, one), accurate_residual({}, centres, centres, P, X, F, {}));
}

__extension__ typedef __float128 Quad;

Quad quad_cube_of_distance(const Vec3& a, const Vec3& b) {
  Quad r2 = 0;
  for (std::size_t k = 0; k < 3; ++k) r2 += (Quad(a[k]) - Quad(b[k])) * (Quad(a[k]) - Quad(b[k]));
  if (r2 == 0) return 0;
  Quad r = std::sqrt(static_cast<Long>(r2));
  r = (r + r2 / r) / 2;  // one Newton step doubles the digits
  return r2 * r;
}

/// The weights with many more digits than a double: refinement with residuals of 113 bits, weights as sums of two doubles.
MatrixXd quad_solution(const std::vector<Vec3>& centres, const MatrixXd& P, const MatrixXd& F) {
  const Index m = F.rows(), n = m + P.cols();
  std::vector<Quad> A(static_cast<std::size_t>(n * n), 0);
  MatrixXd doubles = MatrixXd::Zero(n, n);
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j <= i; ++j) {
      Quad value = 0;
      if (i < m) value = quad_cube_of_distance(centres[static_cast<std::size_t>(i)], centres[static_cast<std::size_t>(j)]);
      if (i >= m && j < m) value = P(j, i - m);
      A[static_cast<std::size_t>(i * n + j)] = A[static_cast<std::size_t>(j * n + i)] = value;
      doubles(i, j) = doubles(j, i) = static_cast<double>(value);
    }
  }
  const Eigen::PartialPivLU<MatrixXd> lu(doubles);
  MatrixXd high = MatrixXd::Zero(n, F.cols()), low = high, residual = high;
  for (int step = 0; step < 5; ++step) {
    for (Index i = 0; i < n; ++i) {
      for (Index c = 0; c < F.cols(); ++c) {
        Quad sum = i < m ? F(i, c) : 0;
        for (Index j = 0; j < n; ++j) sum -= A[static_cast<std::size_t>(i * n + j)] * (Quad(high(j, c)) + Quad(low(j, c)));
        residual(i, c) = static_cast<double>(sum);
      }
    }
    low += lu.solve(residual);
    const MatrixXd total = high + low;
    low -= total - high;
    high = total;
  }
  return high;
}

std::unique_ptr<SaddleFactor> factor_of(Solver solver, const SaddleProblem& problem) {
  if (solver == Solver::cholesky) return factor_cholesky(problem, {});
  return factor_ldlt(problem, {});
}

// A dense sheet above another: the condition is about 1e9, plain solves lose so many digits of the weights.
TEST(Residual, RefinementMakesEverySolverExact) {
  std::vector<Vec3> centres;
  for (int i = 0; i < 16; ++i) {
    for (int j = 0; j < 16; ++j) {
      centres.push_back({i / 20.0, j / 40.0, 0.05 * std::sin(0.3 * i)});
      centres.push_back({i / 20.0 + 0.004, j / 40.0, 0.003 + 0.05 * std::sin(0.3 * i)});
    }
  }
  const auto m = static_cast<Index>(centres.size());
  const auto values = test::random_values(static_cast<std::size_t>(m * 3), 5);
  const MatrixXd F = Eigen::Map<const MatrixXd>(values.data(), m, 3);
  const MatrixXd X = quad_solution(centres, PolynomialSpace(centres, 1).matrix(centres), F);
  for (const Solver solver : {Solver::cholesky, Solver::ldlt}) {
    InterpolationOptions options;
    options.solver = solver;
    const DenseInterpolator system(centres, options, {});
    EXPECT_LT((system.interpolate(F, 0).coefficients - X).norm(), 1e-15 * X.norm()) << to_string(solver);
    MatrixXd plain = MatrixXd::Zero(X.rows(), X.cols());
    plain.topRows(m) = F;
    factor_of(solver, {system.kernel(), centres, system.polynomials()})->solve(plain);
    EXPECT_GT((plain - X).norm(), 1e-12 * X.norm()) << "else this shows nothing";
  }
}

}  // namespace
}  // namespace deform::residual_test
