// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 7.5: least squares with as many centres as a tolerance needs; greedy centres (thesis 4.5).
#include "core/numerics/interpolation/least_squares_interpolator.h"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <cmath>
#include <numeric>
#include <set>

#include "core/mesh/ahmed.h"
#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/numerics/sampling/farthest_points.h"
#include "tests/core/numerics/random_points.h"
#include "tests/support/expect_error.h"

namespace deform::least_squares_interpolator_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using test::expect_error;
using test::random_points;

MatrixXd smooth_values(const std::vector<Vec3>& points) {
  MatrixXd F(static_cast<Index>(points.size()), 3);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3& x = points[i];
    F.row(static_cast<Index>(i)) << std::sin(3 * x[0]), x[1] * x[0], std::cos(2 * x[2] + x[0]);
  }
  return F;
}

/// The matrix of eq. 7.1 with side conditions, written down once more.
MatrixXd matrix_of(const LeastSquaresInterpolator& qr, const RadialKernel& kernel, const std::vector<Vec3>& points,
                   std::size_t k) {
  const auto m = static_cast<Index>(points.size()), q = static_cast<Index>(qr.polynomials().terms());
  MatrixXd A = MatrixXd::Zero(m + q, static_cast<Index>(k) + q);
  const MatrixXd P = qr.polynomials().matrix(points);
  for (Index j = 0; j < static_cast<Index>(k); ++j) {
    const std::uint32_t centre = qr.order()[static_cast<std::size_t>(j)];
    for (Index i = 0; i < m; ++i) {
      A(i, j) = value(kernel, test::squared_distance(points[static_cast<std::size_t>(i)], points[centre]));
    }
    A.col(j).tail(q) = P.row(static_cast<Index>(centre)).transpose();
  }
  A.topRightCorner(m, q) = P;
  return A;
}

/// How many centres have a weight.
std::size_t used(const LeastSquaresInterpolator& qr, const Interpolants& solution) {
  return static_cast<std::size_t>(solution.coefficients.rows()) - qr.polynomials().terms();
}

/// sqrt(|residual|^2 / m) of the dense least squares.
double dense_rms(const MatrixXd& A, const MatrixXd& F) {
  MatrixXd B = MatrixXd::Zero(A.rows(), F.cols());
  B.topRows(F.rows()) = F;
  const MatrixXd X = A.householderQr().solve(B);
  return (A * X - B).norm() / std::sqrt(static_cast<double>(F.rows()));
}

/// The car's surface in coordinates where D = 1.
std::vector<Vec3> body(std::size_t count) {
  AhmedOptions options;
  options.target_points = count;
  const Mesh mesh = ahmed_body(options);
  const Box box = bounding_box(mesh.points);
  std::vector<Vec3> points;
  for (const Vec3& x : mesh.points) {
    Vec3 unit{};
    for (std::size_t k = 0; k < 3; ++k) unit[k] = (x[k] - box.min[k]) / box.diagonal();
    points.push_back(unit);
  }
  return points;
}

TEST(FarthestPointOrder, SpreadsEvenlyAndIsDeterministic) {
  const std::vector<Vec3> points = random_points(500, 1);
  const auto order = farthest_point_order(points, 500);
  ASSERT_EQ(order.size(), 500u);
  EXPECT_EQ(std::set(order.begin(), order.end()).size(), 500u);
  EXPECT_EQ(order, farthest_point_order(points, 500));
  const auto first = farthest_point_order(points, 60);
  EXPECT_TRUE(std::equal(first.begin(), first.end(), order.begin())) << "a shorter order is the beginning of a longer one";
  // Each is the farthest from those before, so their distances fall.
  double before = 1e300;
  for (std::size_t k = 1; k < order.size(); ++k) {
    double nearest = 1e300;
    for (std::size_t j = 0; j < k; ++j) nearest = std::min(nearest, test::squared_distance(points[order[k]], points[order[j]]));
    EXPECT_LE(nearest, before);
    before = nearest;
  }
}

TEST(FarthestPointOrder, TakesTheFirstOfEqualOnesAndCoincidentOnesOnce) {
  const std::vector<Vec3> corners{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {1, 0, 0}, {0.5, 0.5, 0}};
  EXPECT_EQ(farthest_point_order(corners, 6), (std::vector<std::uint32_t>{3, 1, 0, 2, 5}));
  EXPECT_TRUE(farthest_point_order({}, 3).empty());
}

class EveryKernel : public testing::TestWithParam<std::size_t> {
 protected:
  const RadialKernel kernel_ = test::all_kernels()[GetParam()];
};

TEST_P(EveryKernel, StopsAtTheFirstNumberThatIsGoodEnough) {
  const std::vector<Vec3> points = random_points(300, 2);
  const MatrixXd F = smooth_values(points);
  InterpolationOptions options;
  options.kernel = kernel_;
  options.polynomial_degree = std::max(1, properties(kernel_.kernel).order - 1);
  const LeastSquaresInterpolator qr(points, options);
  EXPECT_EQ(qr.weighted(), 300u);
  const std::vector<double> errors = qr.errors(F);
  ASSERT_EQ(errors.size(), 301u);
  for (std::size_t k = 1; k < errors.size(); ++k) EXPECT_LE(errors[k], errors[k - 1]);
  for (const double tolerance : {0.1, 0.02, 0.004}) {
    const Interpolants solution = qr.interpolate(F, tolerance);
    EXPECT_TRUE(solution.converged);
    EXPECT_LE(solution.rms, tolerance);
    EXPECT_NEAR(solution.rms, errors[used(qr, solution)], 1e-12 * solution.rms);
    const double exact = dense_rms(matrix_of(qr, kernel_, points, used(qr, solution)), F);
    EXPECT_NEAR(solution.rms, exact, 1e-9 * exact + 1e-13);
    if (used(qr, solution) > 0) {
      EXPECT_GT(dense_rms(matrix_of(qr, kernel_, points, used(qr, solution) - 1), F), tolerance * (1 - 1e-9));
    }
    // The coefficients are of this least-squares problem, and the errors are those at the points.
    MatrixXd B = MatrixXd::Zero(300 + static_cast<Index>(qr.polynomials().terms()), 3);
    B.topRows(300) = F;
    const MatrixXd left = matrix_of(qr, kernel_, points, used(qr, solution)) * solution.coefficients - B;
    EXPECT_NEAR(left.norm() / std::sqrt(300.0), solution.rms, 1e-9);
    EXPECT_NEAR(left.topRows(300).rowwise().norm().maxCoeff(), solution.residual, 1e-9);
    ASSERT_EQ(solution.residuals.size(), 3);
    for (Index c = 0; c < 3; ++c) EXPECT_NEAR(left.col(c).head(300).cwiseAbs().maxCoeff(), solution.residuals[c], 1e-9);
    const std::vector<double> values = qr.values(solution, points);
    for (Index i = 0; i < 300; ++i) {
      for (Index c = 0; c < 3; ++c) EXPECT_NEAR(values[static_cast<std::size_t>(3 * i + c)], F(i, c) + left(i, c), 1e-9);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, EveryKernel, testing::Range<std::size_t>(0, test::all_kernels().size()), [](const auto& tested) {
  return std::string(properties(test::all_kernels()[tested.param].kernel).name);
});

TEST(LeastSquaresInterpolator, WithAllPointsIsTheInterpolant) {
  const std::vector<Vec3> points = body(2000);
  const MatrixXd F = smooth_values(points);
  const LeastSquaresInterpolator qr(points, {});
  ASSERT_EQ(qr.weighted(), points.size());
  const Interpolants all = qr.interpolate(F, 0);
  EXPECT_EQ(used(qr, all), points.size());
  EXPECT_TRUE(all.converged);
  EXPECT_LE(all.residual, 1e-10);
  const std::vector<double> at_points = qr.values(all, points);
  for (std::size_t i = 0; i < at_points.size(); ++i) {
    EXPECT_NEAR(at_points[i], F(static_cast<Index>(i / 3), static_cast<Index>(i % 3)), 1e-9) << i;
  }
  const DenseInterpolator system(points, {}, {});
  const std::vector<Vec3> at = random_points(200, 3);
  const std::vector<double> ours = qr.values(all, at), theirs = system.values(system.interpolate(F, 0), at);
  for (std::size_t i = 0; i < ours.size(); ++i) EXPECT_NEAR(ours[i], theirs[i], 1e-8) << i;
}

// Thesis 7.5: a smooth field needs few centres.
TEST(LeastSquaresInterpolator, SmoothFieldOnACarNeedsATenth) {
  const std::vector<Vec3> points = body(3000);
  MatrixXd F = 0.05 * smooth_values(points);  // of D
  InterpolationOptions options;
  options.most_centres = points.size() / 10;
  const LeastSquaresInterpolator qr(points, options);
  EXPECT_EQ(qr.weighted(), points.size() / 10);
  const Interpolants solution = qr.interpolate(F, 1e-4);
  EXPECT_TRUE(solution.converged) << solution.rms;
  EXPECT_LE(used(qr, solution), points.size() / 10);
  EXPECT_GT(used(qr, solution), 10u);
  // Away from the points it is the same field, within what the tolerance allows.
  const DenseInterpolator system(points, {}, {});
  std::vector<Vec3> at = random_points(100, 4);
  const std::vector<double> ours = qr.values(solution, at), exact = system.values(system.interpolate(F, 0), at);
  for (std::size_t i = 0; i < ours.size(); ++i) EXPECT_NEAR(ours[i], exact[i], 5e-3) << i;
}

TEST(LeastSquaresInterpolator, AdjointIsTheTranspose) {
  const std::vector<Vec3> points = random_points(150, 12), at = random_points(40, 13);
  InterpolationOptions options;
  options.most_centres = 60;
  const LeastSquaresInterpolator qr(points, options);
  const std::vector<double> f = test::random_values(150, 14), b = test::random_values(154, 15);
  const MatrixXd F = Eigen::Map<const MatrixXd>(f.data(), 150, 1), B = Eigen::Map<const MatrixXd>(b.data(), 154, 1);
  const Interpolants solution = qr.interpolate(F, 0);
  ASSERT_EQ(used(qr, solution), 60u);
  double left = (solution.coefficients.bottomRows(4).transpose() * B.bottomRows(4))(0, 0);
  for (Index j = 0; j < 60; ++j) left += solution.coefficients(j, 0) * B(qr.order()[static_cast<std::size_t>(j)], 0);
  const double right = (F.transpose() * qr.adjoint(B))(0, 0);
  EXPECT_NEAR(left, right, 1e-10 * solution.coefficients.norm() * B.norm());
}

TEST(LeastSquaresInterpolator, AffineFieldsNeedNoCentre) {
  const std::vector<Vec3> points = random_points(100, 5);
  MatrixXd F(100, 1);
  for (Index i = 0; i < 100; ++i) F(i, 0) = 1 + 2 * points[static_cast<std::size_t>(i)][0];
  InterpolationOptions options;
  options.most_centres = 5;
  const LeastSquaresInterpolator qr(points, options);
  const Interpolants solution = qr.interpolate(F, 1e-12);
  EXPECT_EQ(used(qr, solution), 0u);
  EXPECT_TRUE(solution.converged);
  EXPECT_NEAR(qr.values(solution, {{{3, 0, 0}}})[0], 7, 1e-11);
}

MatrixXd bump(const std::vector<Vec3>& points, double width) {
  MatrixXd F = MatrixXd::Zero(static_cast<Index>(points.size()), 3);
  for (std::size_t i = 0; i < points.size(); ++i) {
    F(static_cast<Index>(i), 2) = std::exp(-test::squared_distance(points[i], {0.5, 0.15, 0.3}) / (width * width));
  }
  return F;
}

// Thesis 4.5: where the field is narrow, centres belong there.
TEST(LeastSquaresInterpolator, GreedyCentresFollowANarrowBump) {
  const std::vector<Vec3> points = body(4000);
  const MatrixXd F = bump(points, 0.05);
  constexpr double tolerance = 3e-4;
  InterpolationOptions options;
  options.samples = F;
  options.sample_tolerance = tolerance;
  const LeastSquaresInterpolator even(points, options);
  options.order = CentreOrder::greedy;
  const LeastSquaresInterpolator greedy(points, options);
  const auto a = even.interpolate(F, tolerance), b = greedy.interpolate(F, tolerance);
  EXPECT_TRUE(a.converged);
  EXPECT_TRUE(b.converged);
  EXPECT_EQ(used(even, a), even.weighted());
  EXPECT_EQ(used(greedy, b), greedy.weighted()) << "preparation ends with the samples";
  EXPECT_LE(4 * used(greedy, b), used(even, a));
  EXPECT_LT(used(even, a), points.size());
  const auto share_near = [](const std::vector<Vec3>& places) {
    std::size_t near = 0;
    for (const Vec3& x : places) near += test::squared_distance(x, {0.5, 0.15, 0.3}) < 0.1 * 0.1;
    return static_cast<double>(near) / static_cast<double>(places.size());
  };
  std::vector<Vec3> places;
  for (const std::uint32_t i : greedy.order()) places.push_back(points[i]);
  EXPECT_GT(share_near(places), 4 * share_near(points));
  EXPECT_EQ(LeastSquaresInterpolator(points, options).order(), greedy.order());
}

TEST(LeastSquaresInterpolator, DoesNotDependOnThreads) {
  const std::vector<Vec3> points = random_points(900, 6);
  const MatrixXd F = smooth_values(points);
  for (const CentreOrder order : {CentreOrder::farthest_point, CentreOrder::greedy}) {
    InterpolationOptions options;
    options.order = order;
    options.samples = F;
    options.most_centres = 300;
    RunContext one, many;
    one.threads = 1;
    many.threads = 4;
    const LeastSquaresInterpolator a(points, options, one), b(points, options, many);
    EXPECT_EQ(a.order(), b.order());
    const auto x = a.interpolate(F, 1e-6), y = b.interpolate(F, 1e-6);
    EXPECT_TRUE(x.coefficients == y.coefficients);
  }
}

TEST(LeastSquaresInterpolator, OneFieldOfSeveralSamplesEndsNothing) {
  const std::vector<Vec3> points = random_points(400, 7);
  MatrixXd samples(400, 6);
  samples << MatrixXd::Zero(400, 3), smooth_values(points);
  InterpolationOptions options;
  options.samples = samples;
  options.sample_tolerance = 1e-2;
  const LeastSquaresInterpolator qr(points, options);
  EXPECT_TRUE(qr.interpolate(samples.rightCols(3), 1e-2).converged);
  EXPECT_EQ(used(qr, qr.interpolate(samples.rightCols(3), 1e-2)), qr.weighted());
  EXPECT_EQ(used(qr, qr.interpolate(samples.leftCols(3), 1e-2)), 0u);
}

// Coincident points are one centre; with different values no tolerance below their difference can be met, which is a result.
TEST(LeastSquaresInterpolator, CoincidentPointsBecomeOneCentre) {
  std::vector<Vec3> points = random_points(50, 8);
  points.push_back(points[7]);
  MatrixXd F = smooth_values(points);
  const LeastSquaresInterpolator qr(points, {});
  EXPECT_EQ(qr.weighted(), 50u);
  EXPECT_TRUE(qr.interpolate(F, 1e-9).converged);
  F(50, 0) += 1;
  const auto solution = qr.interpolate(F, 1e-9);
  EXPECT_FALSE(solution.converged);
  EXPECT_NEAR(solution.residual, 0.5, 1e-6);
}

// Columns that depend on others to working precision end the preparation instead of blowing up.
TEST(LeastSquaresInterpolator, StopsAtDependentColumns) {
  const std::vector<Vec3> points = random_points(400, 9);
  InterpolationOptions options;
  options.kernel = {Kernel::gaussian, 2};
  const LeastSquaresInterpolator qr(points, options);
  EXPECT_LT(qr.weighted(), 400u);
  EXPECT_GT(qr.weighted(), 50u);
  EXPECT_LE(qr.interpolate(smooth_values(points), 1e-6).rms, 1e-5);
}

TEST(LeastSquaresInterpolator, KeepsToTheMemoryLimit) {
  const std::vector<Vec3> points = random_points(1000, 10);
  InterpolationOptions options;
  options.memory_limit = 2000000;
  const LeastSquaresInterpolator qr(points, options);
  EXPECT_GT(qr.weighted(), 150u);
  EXPECT_LT(qr.weighted(), 250u);
  EXPECT_LE(qr.bytes(), options.memory_limit);
  EXPECT_LE(qr.bytes(), LeastSquaresInterpolator::bytes_for(1000, qr.weighted()));
  options.memory_limit = 10000;
  expect_error(ErrorCode::out_of_budget, {"1000 points", "available are 10000"},
               [&] { LeastSquaresInterpolator(points, options); });
}

TEST(LeastSquaresInterpolator, RefusesBadInput) {
  const auto refused = [](const std::vector<Vec3>& points, const InterpolationOptions& options, const char* message) {
    expect_error(ErrorCode::invalid_argument, {message}, [&] { LeastSquaresInterpolator(points, options); });
  };
  const std::vector<Vec3> points = random_points(20, 11);
  refused({}, {}, "points: there are none");
  refused({{0, 0, 0}, {0, NAN, 0}}, {}, "points[1]: must be finite");
  InterpolationOptions options;
  options.polynomial_degree = 0;
  refused(points, options, "polynomial_degree: 0 is out of range 1..2");
  options = {};
  options.order = CentreOrder::greedy;
  refused(points, options, "samples: expected 20 rows");
  options.samples = MatrixXd::Constant(20, 3, INFINITY);
  refused(points, options, "samples[0]: must be finite");
  options.samples = MatrixXd::Ones(19, 3);
  refused(points, options, "got 19 x 3");
  options = {};
  options.sample_tolerance = -1;
  refused(points, options, "sample_tolerance");
  const LeastSquaresInterpolator qr(points, {});
  expect_error(ErrorCode::invalid_argument, {"values: expected 20 rows"}, [&] { qr.interpolate(MatrixXd::Ones(3, 3), 1); });
  expect_error(ErrorCode::invalid_argument, {"tolerance"}, [&] { qr.interpolate(MatrixXd::Ones(20, 3), NAN); });
  RunContext cancelled;
  std::stop_source stop;
  cancelled.stop = stop.get_token();
  stop.request_stop();
  expect_error(ErrorCode::cancelled, {}, [&] { LeastSquaresInterpolator(points, {}, cancelled); });
}

}  // namespace
}  // namespace deform::least_squares_interpolator_test
