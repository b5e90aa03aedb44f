// SPDX-License-Identifier: GPL-3.0-or-later
// Fast sums against direct ones where they are evaluated, for points and centres that lie in each other in every way: each makes
// the two trees meet on other levels, so that other lists of the method are all there is.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

#include "core/numerics/fast_sums/checked_sums.h"
#include "core/numerics/fast_sums/fast_sums.h"
#include "core/numerics/kernels/tiles.h"
#include "tests/core/numerics/random_points.h"
#include "tests/support/long_tests.h"

namespace deform::fast_sums_nesting_test {
namespace {

using Cloud = std::vector<Vec3>;

Cloud volume(std::size_t count, std::uint64_t seed) { return test::random_points(count, seed); }

/// On a bent sheet that is denser towards one end.
Cloud surface(std::size_t count, std::uint64_t seed) {
  Cloud points = test::random_points(count, seed);
  for (Vec3& p : points) p = {p[0] * p[0], p[1], 0.5 + 0.3 * std::sin(4 * p[0] * p[0]) * std::cos(3 * p[1])};
  return points;
}

Cloud moved(Cloud points, double scale, const Vec3& to) {
  for (Vec3& p : points) {
    for (std::size_t k = 0; k < 3; ++k) p[k] = to[k] + scale * (p[k] - 0.5);
  }
  return points;
}

/// Most of them in a few small balls.
Cloud clustered(Cloud points) {
  const Cloud balls = test::random_points(5, 9);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i % 8 == 0) continue;
    for (std::size_t k = 0; k < 3; ++k) points[i][k] = balls[i % 5][k] + 1e-4 * points[i][k];
  }
  return points;
}

struct Nesting {
  const char* name;
  std::function<Cloud(const Cloud&)> points;  ///< from an even cloud
  std::function<Cloud(const Cloud&)> centres;
};

std::vector<Nesting> nestings() {
  const auto as_they_are = [](const Cloud& cloud) { return cloud; };
  const auto scaled = [](double scale, const Vec3& to) { return [=](const Cloud& cloud) { return moved(cloud, scale, to); }; };
  const Vec3 inside{0.43, 0.38, 0.55};
  return {{"both even", as_they_are, as_they_are},
          {"points in a ball inside", scaled(0.05, inside), as_they_are},
          {"points far deeper than centres", scaled(1e-4, inside), as_they_are},
          {"points deeper, beside the centres", scaled(1e-2, {1.3, 0.5, 0.6}), as_they_are},
          {"centres in a ball inside", as_they_are, scaled(0.05, inside)},
          {"centres far deeper than points", as_they_are, scaled(1e-4, inside)},
          {"disjoint", scaled(1, {2.7, 0.8, 0.5}), as_they_are},
          {"far apart", scaled(0.1, {9, 9, 9}), scaled(0.2, {0.2, 0.1, 0.3})},
          {"one point", [](const Cloud& cloud) { return Cloud{cloud[0]}; }, as_they_are},
          {"one point outside",
           [](const Cloud&) {
             return Cloud{{1.9, 0.1, 0.2}};
           },
           as_they_are},
          {"points around the centres", scaled(4, {0.5, 0.5, 0.5}), as_they_are},
          {"points in clusters", clustered, as_they_are},
          {"centres in clusters", as_they_are, clustered},
          {"both in clusters", clustered, clustered}};
}

/// Largest error over the points relative to the largest sum of absolute values at points and centres.
struct Case {
  Case(const RadialKernel& of_kernel, Cloud at_points, Cloud of_centres)
      : kernel(of_kernel), points(std::move(at_points)), centres(std::move(of_centres)) {
    weights = test::random_values(2 * centres.size(), 3);
    std::vector<double> absolute(weights);
    for (double& w : absolute) w = std::abs(w);
    exact = kernel_sums(kernel, points, centres, weights, 2, {});
    for (const Cloud* at : {&points, &centres}) {
      for (const double sum : kernel_sums(kernel, *at, centres, absolute, 2, {})) scale = std::max(scale, std::abs(sum));
    }
  }

  double error(const FastSums::Options& options) const {
    return error(FastSums(kernel, points, centres, options).sums(weights, 2));
  }
  double error(const std::vector<double>& fast) const {
    double largest = 0;
    for (std::size_t i = 0; i < exact.size(); ++i) largest = std::max(largest, std::abs(fast[i] - exact[i]));
    return scale > 0 ? largest / scale : largest;
  }

  RadialKernel kernel;
  Cloud points, centres;
  std::vector<double> weights, exact;
  double scale = 0;
};

TEST(FastSums, HoldForPointsAndCentresInEveryNesting) {
  struct Row {
    FastSums::Options options;
    double limit;
  };
  // Small leaves make trees of several levels of a few hundred points; 0 is what the solver takes.
  const Row rows[] = {{{4, 5}, 1e-2}, {{4, 0}, 1e-2}, {{6, 0}, 1e-3}, {{6, 20}, 1e-3}, {{8, 0}, 1e-4}, {{10, 0}, 1e-5}};
  for (const RadialKernel& kernel : test::all_kernels()) {
    if (kernel.kernel == Kernel::wendland_c2) continue;
    for (const Nesting& nesting : nestings()) {
      for (const bool flat : {true, false}) {
        for (const std::size_t count : {std::size_t{30}, std::size_t{150}, std::size_t{600}, std::size_t{3000}}) {
          const auto cloud = flat ? surface : volume;
          const Case sums(kernel, nesting.points(cloud(900, 5)), nesting.centres(cloud(count, 6)));
          for (const Row& row : rows) {
            if (count > 600 && row.options.leaf_points > 0 && !test::long_tests()) continue;  // as deep with fewer points
            EXPECT_LT(sums.error(row.options), row.limit)
                << properties(kernel.kernel).name << ", " << nesting.name << ", " << (flat ? "surface" : "volume") << ", "
                << count << " centres, order " << row.options.order << ", leaves of " << row.options.leaf_points;
          }
        }
      }
    }
  }
}

TEST(CheckedSums, RaiseTheOrderUntilTheSumsAreAllowedAtTheirOwnPoints) {
  constexpr double allowed = 1e-9;
  for (const RadialKernel& kernel : test::all_kernels()) {
    if (kernel.kernel == Kernel::wendland_c2) continue;
    for (const Nesting& nesting : nestings()) {
      const Case sums(kernel, nesting.points(surface(2000, 5)), nesting.centres(surface(700, 6)));
      const auto got = checked_sums(kernel, sums.points, sums.centres, sums.weights, 2, {4, allowed * sums.scale, 0}, {}).sums;
      EXPECT_LT(sums.error(got), allowed) << properties(kernel.kernel).name << ", " << nesting.name;
      const auto digits = checked_sums(kernel, sums.points, sums.centres, sums.weights, 2, {6, 0, 1e-7}, {}).sums;
      EXPECT_LT(sums.error(digits), 1e-7) << properties(kernel.kernel).name << ", " << nesting.name;
    }
  }
}

/// Where nothing is interpolated there is no error beyond that of the order of summation.
TEST(FastSums, FewPointsAreSummedDirectly) {
  const Case sums({Kernel::triharmonic, 1}, volume(40, 5), volume(60, 6));
  EXPECT_LT(sums.error(FastSums::Options{8, 0}), 1e-15);
}

}  // namespace
}  // namespace deform::fast_sums_nesting_test
