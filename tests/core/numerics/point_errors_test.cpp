// SPDX-License-Identifier: GPL-3.0-or-later
// Where approximate interpolants are checked, and which rows are the worst: against sorting by definition.
#include "core/numerics/interpolation/point_errors.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
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

namespace deform {
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

TEST(WorstRows, AreThoseOfALargestEntryByDefinition) {
  for (const Eigen::Index count : {0, 1, 31, 32, 33, 200}) {
    Eigen::MatrixXd residual(count, 3);
    const std::vector<double> values = test::random_values(static_cast<std::size_t>(3 * count), 8);
    std::copy(values.begin(), values.end(), residual.data());
    // Signs do not count, and of equal ones the first comes first.
    if (count == 200) residual.row(150) = -residual.row(20), residual.row(170) = residual.row(20);
    std::vector<std::pair<double, std::uint32_t>> wanted;
    for (Eigen::Index i = 0; i < count; ++i) {
      wanted.emplace_back(-std::max({std::abs(residual(i, 0)), std::abs(residual(i, 1)), std::abs(residual(i, 2))}), i);
    }
    std::sort(wanted.begin(), wanted.end());
    wanted.resize(std::min<std::size_t>(wanted.size(), 32));
    std::vector<std::uint32_t> rows;
    for (const auto& [size, row] : wanted) rows.push_back(row);
    EXPECT_EQ(worst_rows(residual), rows) << count;
  }
}

TEST(LargestMagnitude, IsInfiniteWhereANumberIsMissing) {
  Eigen::MatrixXd errors(2, 2);
  errors << 1, -3, 2, 0;
  EXPECT_EQ(largest_magnitude(errors), 3);
  EXPECT_EQ(largest_magnitude(Eigen::MatrixXd(0, 3)), 0);
  errors(1, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(largest_magnitude(errors), std::numeric_limits<double>::infinity());
}

bool long_tests() { return std::getenv("DEFORM_LONG") != nullptr; }

/// Patches of centres on an ellipsoid, each with a smooth motion of its own, and places all over it.
struct Checked {
  std::vector<Vec3> centres, places;
  Eigen::MatrixXd F;

  Checked(std::size_t m, std::size_t count, std::uint64_t seed) {
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
      const Vec3 x = on_ellipsoid();
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

struct Found {
  double condition = 0, error = 0;  ///< of the dense system; true
  double all = 0, part = 0;         ///< estimated from all centres and from a part of them, with the margin of the product
};

/// Against the dense solution, with residuals of twice the digits.
Found found(Kernel kernel, Solver solver, std::size_t m, double tolerance, std::uint64_t seed,
            const PointErrors::Limits& limits) {
  const Checked given(m, 384, seed);
  InterpolationOptions options;
  options.kernel = {kernel, properties(kernel).has_shape ? 0.03 * std::sqrt(650.0 / static_cast<double>(m)) : 1.0};
  options.polynomial_degree = properties(kernel).default_degree();
  const DenseInterpolator dense(given.centres, options, {});
  options.solver = solver;
  if (solver == Solver::incremental_qr) {
    options.samples = given.F;
    options.sample_tolerance = tolerance;
  }
  const auto system = make_interpolator(given.centres, options, {});
  const Interpolants interpolants = system->interpolate(given.F, tolerance);
  const Interpolants exact = dense.interpolate(given.F, 0);
  const auto n = static_cast<Eigen::Index>(given.places.size());
  const Eigen::MatrixXd none = Eigen::MatrixXd::Zero(n, 3);
  Found result;
  result.condition = dense.condition();
  result.error = largest_magnitude(system->accurate_residual(interpolants, given.places, none) -
                                   dense.accurate_residual(exact, given.places, none));
  const auto estimated = [&](const PointErrors::Limits& of) {
    const PointErrors check(*system, options.polynomial_degree, given.places, {}, of);
    return error_margin * largest_magnitude(check.errors(check.missing(*system, interpolants, given.F, {}), {}));
  };
  result.all = estimated(limits);
  result.part = estimated({limits.dense, 0});
  return result;
}

/// What a part of the centres says is too little where residuals change from centre to centre, or errors are local.
TEST(PointErrors, AreNotUnderestimatedWhereThereAreManyCentres) {
  struct Row {
    Kernel kernel;
    Solver solver;
    double tolerance;
  };
  const Row rows[] = {{Kernel::triharmonic, Solver::incremental_qr, 1e-5},
                      {Kernel::biharmonic, Solver::incremental_qr, 1e-3},
                      {Kernel::gaussian, Solver::incremental_qr, 1e-3},
                      {Kernel::gaussian, Solver::iterative, 1e-3},
                      {Kernel::inverse_multiquadric, Solver::iterative, 1e-3},
                      {Kernel::multiquadric, Solver::iterative, 1e-3},
                      {Kernel::inverse_multiquadric, Solver::incremental_qr, 1e-3}};
  double least_part = std::numeric_limits<double>::infinity();
  std::vector<double> ratios;
  for (const Row& row : rows) {
    for (std::uint64_t seed = 0; seed < (long_tests() ? 3u : 2u); ++seed) {
      const std::size_t m = long_tests() ? 3200 + 1700 * seed : 600 + 100 * seed;
      const PointErrors::Limits limits = long_tests() ? PointErrors::Limits{} : PointErrors::Limits{250, 20000};
      const Found is = found(row.kernel, row.solver, m, row.tolerance, seed, limits);
      const std::string text = std::string(properties(row.kernel).name) +
                               (row.solver == Solver::iterative ? ", iterative, " : ", QR, ") + std::to_string(m) +
                               " centres: " + std::to_string(is.error) + ", all " + std::to_string(is.all / is.error) +
                               ", part " + std::to_string(is.part / is.error);
      if (is.condition > 1e15) continue;  // no digits left to compare with
      EXPECT_GE(is.all, 0.5 * is.error) << text;
      if (long_tests()) std::printf("%s\n", text.c_str());
      if (!(is.error > 0)) continue;
      ratios.push_back(is.all / is.error);
      least_part = std::min(least_part, is.part / is.error);
    }
  }
  std::sort(ratios.begin(), ratios.end());
  EXPECT_LE(ratios[ratios.size() / 2], 20);
  if (!long_tests()) {
    EXPECT_LT(least_part, 0.5) << "a part of the centres would have done";
  }
}

}  // namespace
}  // namespace deform
