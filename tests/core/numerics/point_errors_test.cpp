// SPDX-License-Identifier: GPL-3.0-or-later
// Where approximate interpolants are checked, and which rows are the worst: against sorting by definition.
#include "core/numerics/interpolation/point_errors.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

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

}  // namespace
}  // namespace deform
