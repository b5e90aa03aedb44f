// SPDX-License-Identifier: GPL-3.0-or-later
// Where approximate interpolants are checked, against sorting by definition, and their estimated errors against dense solutions.
#include "core/numerics/interpolation/point_errors.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <numeric>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/numerics/interpolation/interpolator.h"
#include "tests/core/numerics/random_points.h"
#include "tests/support/long_tests.h"

namespace deform::point_errors_test {
namespace {

/// The numbers of the points, those next to a centre first.
std::vector<std::uint32_t> by_distance(const std::vector<Vec3>& points, const std::vector<Vec3>& centres) {
  std::vector<std::pair<double, std::uint32_t>> order;
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const Vec3& c : centres) nearest = std::min(nearest, test::squared_distance(points[i], c));
    order.emplace_back(nearest, i);
  }
  std::sort(order.begin(), order.end());
  std::vector<std::uint32_t> numbers;
  for (const auto& [distance, i] : order) numbers.push_back(i);
  return numbers;
}

class CheckPoints : public testing::TestWithParam<std::size_t> {};

TEST_P(CheckPoints, AreFarFromCentresNextToThemAndAmongAll) {
  const std::size_t most = GetParam();
  const std::vector<Vec3> points = test::random_points(5000, 3), centres = test::random_points(60, 4);
  const std::vector<std::uint32_t> chosen = check_points(points, centres, most);
  EXPECT_EQ(chosen.size(), most) << "as many as are asked for";
  EXPECT_TRUE(std::is_sorted(chosen.begin(), chosen.end()));
  const std::set<std::uint32_t> distinct(chosen.begin(), chosen.end());
  EXPECT_EQ(distinct.size(), most);
  const std::vector<std::uint32_t> order = by_distance(points, centres);
  const auto among = [&](std::size_t begin, std::size_t end) {
    return static_cast<std::size_t>(std::count_if(order.begin() + static_cast<std::ptrdiff_t>(begin),
                                                  order.begin() + static_cast<std::ptrdiff_t>(end),
                                                  [&](std::uint32_t i) { return distinct.count(i) > 0; }));
  };
  EXPECT_EQ(among(5000 - most / 8, 5000), most / 8) << "the farthest of all";
  EXPECT_GE(among(0, 500), most / 4) << "the nearest tenth";
  EXPECT_GE(among(4500, 5000), most / 4) << "the farthest tenth";
  for (std::size_t part = 1; part < 9; ++part) EXPECT_GE(among(500 * part, 500 * part + 500), most / 64) << part;
}
INSTANTIATE_TEST_SUITE_P(Sizes, CheckPoints, testing::Values(64, 384, 1024));

TEST(CheckPoints, AreAllWhereThereAreNoMore) {
  const std::vector<Vec3> points = test::random_points(384, 5), centres = test::random_points(10, 6);
  std::vector<std::uint32_t> all(384);
  std::iota(all.begin(), all.end(), 0u);
  EXPECT_EQ(check_points(points, centres), all);
  EXPECT_EQ(check_points(points, {}).size(), 384u);
  EXPECT_EQ(check_points(points, centres, 383).size(), 383u);
  EXPECT_EQ(check_points(points, {}, 100).size(), 100u) << "without a centre none is farther than another";
  EXPECT_TRUE(check_points({}, centres).empty());
}

TEST(LargestMagnitude, IsInfiniteWhereANumberIsMissing) {
  Eigen::MatrixXd errors(2, 2);
  errors << 1, -3, 2, 0;
  EXPECT_EQ(largest_magnitude(errors), 3);
  EXPECT_EQ(largest_magnitude(Eigen::MatrixXd(0, 3)), 0);
  errors(1, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(largest_magnitude(errors), std::numeric_limits<double>::infinity());
}

/// Patches of centres on an ellipsoid, each with a smooth motion of its own, and places all over it.
struct Checked {
  std::vector<Vec3> centres, places;
  Eigen::MatrixXd F;

  Checked(std::size_t m, std::size_t count, std::uint64_t seed, const Parity& parity = {}) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(-1, 1);
    const auto on_ellipsoid = [&] {
      const Vec3 p{normal(random), normal(random), normal(random)};
      const double size = std::hypot(p[0], p[1], p[2]);
      return Vec3{0.5 + 0.5 * p[0] / size, 0.3 + 0.3 * p[1] / size, 0.4 + 0.4 * p[2] / size};
    };
    const std::size_t patches = 2 + random() % 3;
    std::vector<Vec3> middles;
    for (std::size_t p = 0; p < patches; ++p) middles.push_back(on_ellipsoid());
    std::vector<std::pair<double, Vec3>> all;
    while (all.size() < 3 * m) {
      Vec3 x = on_ellipsoid();
      for (std::size_t k = 0; k < 3; ++k) {
        // Some are on the planes of reflection; where functions are odd these are no centres.
        if (parity.sign[k] != 0 && x[k] < 0.02) x[k] = parity.sign[k] > 0 ? 0 : 0.02;
      }
      double nearest = std::numeric_limits<double>::infinity();
      for (const Vec3& c : middles) nearest = std::min(nearest, test::squared_distance(x, c));
      all.emplace_back(nearest, x);
    }
    std::nth_element(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(m), all.end());
    std::vector<Eigen::Matrix<double, 4, 3>> motions(patches);
    for (auto& motion : motions) motion = Eigen::Matrix<double, 4, 3>::NullaryExpr([&] { return 0.2 * uniform(random); });
    F.resize(static_cast<Eigen::Index>(m), 3);
    for (std::size_t i = 0; i < m; ++i) {
      const Vec3& x = all[i].second;
      centres.push_back(x);
      std::size_t nearest = 0;
      for (std::size_t p = 1; p < patches; ++p) {
        if (test::squared_distance(x, middles[p]) < test::squared_distance(x, middles[nearest])) nearest = p;
      }
      F.row(static_cast<Eigen::Index>(i)) = Eigen::RowVector4d(1, x[0], x[1], x[2]) * motions[nearest];
    }
    std::vector<Vec3> free;
    for (std::size_t i = m; i < all.size(); ++i) free.push_back(all[i].second);
    for (const std::uint32_t i : check_points(free, centres, count)) places.push_back(free[i]);
  }
};

struct Row {
  Kernel kernel;
  Solver solver;
  double tolerance;
  Parity parity{};

  std::string text() const {
    const auto reflected = [&](int sign) { return std::count(parity.sign.begin(), parity.sign.end(), sign); };
    return std::string(properties(kernel).name) + (solver == Solver::iterative ? ", iterative, " : ", QR, ") +
           std::to_string(reflected(1)) + " even, " + std::to_string(reflected(-1)) + " odd";
  }
  InterpolationOptions options(std::size_t m) const {
    InterpolationOptions result;
    // A share of the model, but a few centres wide where the kernel is analytic.
    const double wide = kernel == Kernel::wendland_c2 ? 0.3 : 0.03 * std::sqrt(650.0 / static_cast<double>(m));
    result.kernel = {kernel, properties(kernel).has_shape ? wide : 1.0, parity};
    result.polynomial_degree = properties(kernel).default_degree();
    return result;
  }
};

/// An approximate solution and its true errors: those of the dense one are at rounding, with residuals of twice the digits.
struct Approximate {
  Checked given;
  InterpolationOptions options;
  double condition = 0;
  std::unique_ptr<const Interpolator> system;
  Interpolants interpolants;
  Eigen::MatrixXd errors;  ///< at the places

  Approximate(const Row& row, std::size_t m, std::size_t places, std::uint64_t seed)
      : given(m, places, seed, row.parity), options(row.options(m)) {
    const DenseInterpolator dense(given.centres, options, {});
    condition = dense.condition();
    options.solver = row.solver;
    if (row.solver == Solver::incremental_qr) {
      options.samples = given.F;
      options.sample_tolerance = row.tolerance;
    }
    system = make_interpolator(given.centres, options, {});
    interpolants = system->interpolate(given.F, row.tolerance);
    const Eigen::MatrixXd none = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(given.places.size()), 3);
    errors = system->accurate_residual(interpolants, given.places, none) -
             dense.accurate_residual(dense.interpolate(given.F, 0), given.places, none);
  }
};

/// Residuals at all centres say the errors at the places, with every kernel and solver and with reflections, whether they are
/// interpolated by a dense factorization or iteratively.
TEST(PointErrors, AreThoseOfDenseSolutions) {
  const Row rows[] = {{Kernel::triharmonic, Solver::incremental_qr, 1e-5},
                      {Kernel::biharmonic, Solver::incremental_qr, 1e-3},
                      {Kernel::gaussian, Solver::incremental_qr, 1e-3},
                      {Kernel::inverse_multiquadric, Solver::incremental_qr, 1e-3},
                      {Kernel::wendland_c2, Solver::incremental_qr, 1e-4},
                      {Kernel::triharmonic, Solver::incremental_qr, 1e-5, {{1, 0, 0}}},
                      {Kernel::triharmonic, Solver::incremental_qr, 1e-5, {{0, -1, 0}}},
                      {Kernel::biharmonic, Solver::incremental_qr, 1e-3, {{-1, 0, 1}}},
                      {Kernel::gaussian, Solver::incremental_qr, 1e-3, {{1, 1, 0}}},
                      {Kernel::wendland_c2, Solver::incremental_qr, 1e-4, {{1, 0, 0}}},
                      {Kernel::triharmonic, Solver::iterative, 1e-5},
                      {Kernel::biharmonic, Solver::iterative, 1e-3},
                      {Kernel::quintic, Solver::iterative, 1e-4},
                      {Kernel::gaussian, Solver::iterative, 1e-3},
                      {Kernel::inverse_multiquadric, Solver::iterative, 1e-3},
                      {Kernel::multiquadric, Solver::iterative, 1e-3}};
  std::size_t compared = 0;
  for (const Row& row : rows) {
    for (std::uint64_t seed = 0; seed < (test::long_tests() ? 3u : 2u); ++seed) {
      const std::size_t m = test::long_tests() ? 3200 + 700 * seed : 600 + 100 * seed;
      const Approximate is(row, m, 384, seed);
      const double size = is.given.F.cwiseAbs().maxCoeff();
      if (is.condition > 1e14 || !(is.errors.cwiseAbs().maxCoeff() > 1e-10 * size)) continue;  // too few digits to compare
      ++compared;
      for (const std::size_t dense : {std::size_t{250}, std::size_t{1000}}) {
        if (test::long_tests() && dense == 1000) continue;
        const PointErrors check(*is.system, is.options.polynomial_degree, is.given.places, {}, dense);
        EXPECT_EQ(check.complete(), m <= dense);
        const Eigen::MatrixXd told = check.errors(check.missing(*is.system, is.interpolants, is.given.F, {}), {});
        const double missed = (told - is.errors).cwiseAbs().maxCoeff() / is.errors.cwiseAbs().maxCoeff();
        EXPECT_LE(missed, 0.05) << row.text() << ", " << m << " centres, dense up to " << dense << ", condition " << is.condition;
        if (test::long_tests()) std::printf("%s, %zu centres: missed by %g\n", row.text().c_str(), m, missed);
      }
    }
  }
  EXPECT_GE(compared, 24u);
}

/// Sums over many points are fast ones, to a share of what is known at the places; a column that is much smaller is not lost.
TEST(PointErrors, AreSoughtAtAllPoints) {
  for (const Kernel kernel : {Kernel::triharmonic, Kernel::gaussian}) {
    Approximate is({kernel, Solver::incremental_qr, 1e-4}, 600, 64, 5);
    const std::vector<Vec3> points = test::random_points(170000, 7);
    for (const std::size_t dense : {std::size_t{250}, std::size_t{1000}}) {
      const PointErrors check(*is.system, is.options.polynomial_degree, is.given.places, {}, dense);
      PointErrors::Missing missing = check.missing(*is.system, is.interpolants, is.given.F, {});
      missing.coefficients.col(1) *= 1e-7;
      const Eigen::MatrixXd at_places = check.errors(missing, {}), everywhere = check.errors(missing, points, {});
      const Eigen::VectorXd found = check.largest(missing, at_places, points, {});
      for (Eigen::Index c = 0; c < 3; ++c) {
        const double known = largest_magnitude(at_places.col(c));
        const double wanted = std::max(known, largest_magnitude(everywhere.col(c)));
        EXPECT_GE(found[c], wanted) << c;
        EXPECT_LE(found[c], wanted + 0.1 * known) << c;
      }
    }
  }
}

}  // namespace
}  // namespace deform::point_errors_test
