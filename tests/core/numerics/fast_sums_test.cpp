// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/fast_sums/fast_sums.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/base/error.h"
#include "core/numerics/fast_sums/octree.h"
#include "core/numerics/kernels/tiles.h"
#include "tests/core/numerics/random_points.h"

namespace deform::fast_sums_test {
namespace {

/// On an ellipsoid, denser towards one end by orders of magnitude: what a refined surface mesh looks like to a tree.
std::vector<Vec3> graded_surface(std::size_t count) {
  std::vector<Vec3> points = test::random_points(count, 7);
  for (Vec3& p : points) {
    const double along = std::pow(p[0], 4), around = 6.283185307179586 * p[1];
    const double radius = 0.3 * std::sqrt(std::max(0.0, 4 * along * (1 - along)));
    p = {along, 0.5 + radius * std::cos(around), 0.5 + 0.5 * radius * std::sin(around)};
  }
  return points;
}

/// Largest error of the fast sums, relative to the sum of the absolute values of what is summed.
double relative_error(const RadialKernel& kernel, const std::vector<Vec3>& points, const std::vector<Vec3>& centres, int order) {
  const std::vector<double> weights = test::random_values(3 * centres.size(), 3);
  std::vector<double> absolute(weights);
  for (double& w : absolute) w = std::abs(w);
  const std::vector<double> exact = kernel_sums(kernel, points, centres, weights, 3, {});
  const std::vector<double> scale = kernel_sums(kernel, points, centres, absolute, 3, {});
  const std::vector<double> fast = FastSums(kernel, points, centres, {order, 60}).sums(weights, 3);
  double largest = 0;
  for (std::size_t i = 0; i < exact.size(); ++i) largest = std::max(largest, std::abs(fast[i] - exact[i]) / std::abs(scale[i]));
  return largest;
}

TEST(Octree, HoldsEveryPointOnceInNestedBoxes) {
  const std::vector<Vec3> points = graded_surface(5000);
  const Octree tree(points, enclosing_cube(points, points), 50);
  std::vector<std::uint32_t> order = tree.order();
  std::sort(order.begin(), order.end());
  for (std::uint32_t i = 0; i < order.size(); ++i) ASSERT_EQ(order[i], i);
  for (const Octree::Box& box : tree.boxes()) {
    const Vec3 centre = tree.centre(box);
    const double half = tree.half(box.level) * (1 + 1e-12);
    for (std::uint32_t i = box.begin; i < box.end; ++i) {
      EXPECT_EQ(tree.points()[i], points[tree.order()[i]]);
      for (std::size_t k = 0; k < 3; ++k) ASSERT_LE(std::abs(tree.points()[i][k] - centre[k]), half);
    }
    if (box.leaf()) {
      EXPECT_LE(box.count(), 50u);
      continue;
    }
    std::uint32_t next = box.begin;
    for (std::uint32_t c = box.child; c < box.child + box.children; ++c) {
      EXPECT_EQ(tree.boxes()[c].begin, next);
      EXPECT_EQ(tree.boxes()[c].level, box.level + 1);
      next = tree.boxes()[c].end;
    }
    EXPECT_EQ(next, box.end);
  }
}

TEST(Octree, CoincidentPointsEndTheSplitting) {
  const std::vector<Vec3> points(300, Vec3{0.1, 0.2, 0.3});
  const Octree tree(points, enclosing_cube(points, points), 10);
  EXPECT_LE(tree.levels(), 21u);
  EXPECT_EQ(tree.boxes().back().count(), 300u);
}

TEST(FastSums, EveryTwoOrdersGainDigits) {
  const std::vector<Vec3> points = graded_surface(8000);
  const std::vector<Vec3> some(points.begin(), points.begin() + 1000);
  for (const RadialKernel& kernel : test::all_kernels()) {
    if (kernel.kernel == Kernel::wendland_c2) continue;
    const char* name = properties(kernel.kernel).name;
    double before = relative_error(kernel, some, points, 4);
    EXPECT_LT(before, 1e-2) << name;
    EXPECT_GT(before, 0) << name << ": nothing was interpolated";
    for (int order = 6; order <= 8; order += 2) {
      const double error = relative_error(kernel, some, points, order);
      EXPECT_LT(error, 0.2 * before) << name << " of order " << order;
      before = error;
    }
    EXPECT_LT(before, 1e-5) << name;
  }
}

TEST(FastSums, PointsMayBeOthersThanTheCentres) {
  const std::vector<Vec3> centres = graded_surface(4000);
  std::vector<Vec3> points = test::random_points(3000, 5);
  for (Vec3& p : points) p = {3 * p[0] - 1, 3 * p[1] - 1, 3 * p[2] - 1};
  EXPECT_LT(relative_error({Kernel::triharmonic, 1}, points, centres, 10), 1e-9);
  EXPECT_LT(relative_error({Kernel::biharmonic, 1}, points, centres, 10), 1e-8);
  EXPECT_LT(relative_error({Kernel::triharmonic, 1}, {points.begin(), points.begin() + 1}, centres, 10), 1e-9);
  EXPECT_LT(relative_error({Kernel::triharmonic, 1}, points, {centres.begin(), centres.begin() + 1}, 10), 1e-13);
}

TEST(FastSums, NothingGivesNothing) {
  const std::vector<Vec3> some = graded_surface(10);
  EXPECT_TRUE(FastSums({}, {}, some, {}).sums(std::vector<double>(10, 1.0), 1).empty());
  EXPECT_EQ(FastSums({}, some, {}, {}).sums({}, 1), std::vector<double>(10, 0.0));
}

TEST(FastSums, ThreadsAndGroupsOfColumnsDoNotMatter) {
  const std::vector<Vec3> points = graded_surface(6000);
  const FastSums sums({Kernel::triharmonic, 1}, points, points, {6, 60});
  constexpr std::size_t columns = 17;
  const std::vector<double> weights = test::random_values(columns * points.size(), 3);
  RunContext one;
  one.threads = 1;
  const std::vector<double> together = sums.sums(weights, columns);
  EXPECT_EQ(together, sums.sums(weights, columns, one));
  std::vector<double> single(points.size());
  for (const std::size_t c : {std::size_t{0}, std::size_t{5}, std::size_t{16}}) {
    for (std::size_t j = 0; j < points.size(); ++j) single[j] = weights[j * columns + c];
    const std::vector<double> alone = sums.sums(single, 1);
    for (std::size_t i = 0; i < points.size(); ++i) ASSERT_EQ(alone[i], together[i * columns + c]) << i << ' ' << c;
  }
}

TEST(FastSums, CanBeCancelled) {
  const std::vector<Vec3> points = graded_surface(3000);
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  const FastSums sums({Kernel::triharmonic, 1}, points, points, {6, 60});
  EXPECT_THROW(sums.sums(std::vector<double>(points.size(), 1.0), 1, context), Error);
}

}  // namespace
}  // namespace deform::fast_sums_test
