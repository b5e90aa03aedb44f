// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sampling/near_cells.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>
#include <vector>

namespace deform::near_cells_test {
namespace {

std::vector<std::uint32_t> found(const NearCells& cells, const Vec3& x) {
  std::vector<std::uint32_t> result;
  cells.for_each(x, [&](std::uint32_t i, double) { result.push_back(i); });
  return result;
}

TEST(NearCells, finds_the_points_nearer_than_the_radius_in_ascending_order) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<Vec3> points(700);
  for (Vec3& x : points) x = {1e3 + uniform(random), uniform(random), 0.1 * uniform(random)};
  points.push_back(points.front());
  for (const double radius : {1e-3, 0.05, 0.3, 5.0}) {
    const NearCells cells(points, radius);
    std::size_t all = 0;
    for (int k = 0; k < 400; ++k) {
      // Some of the places are points, some lie beside all of them.
      const Vec3 x = k < 100 ? points[static_cast<std::size_t>(k)]
                             : Vec3{1e3 + 1.3 * uniform(random), 1.3 * uniform(random), 0.3 * uniform(random)};
      std::vector<std::uint32_t> expected;
      for (std::uint32_t i = 0; i < points.size(); ++i) {
        const double dx = x[0] - points[i][0], dy = x[1] - points[i][1], dz = x[2] - points[i][2];
        if (dx * dx + dy * dy + dz * dz < radius * radius) expected.push_back(i);
      }
      EXPECT_EQ(found(cells, x), expected) << radius;
      all += expected.size();
    }
    EXPECT_GE(all, 101u) << radius;  // one is there twice
  }
}

TEST(NearCells, takes_any_place) {
  const NearCells cells(std::vector<Vec3>{{0, 0, 0}, {1, 0, 0}}, 1e-6);
  const double huge = std::numeric_limits<double>::max(), nan = std::numeric_limits<double>::quiet_NaN();
  for (const Vec3& x : {Vec3{huge, 0, 0}, {0, -huge, 0}, {nan, 0, 0}, {0, 0, std::numeric_limits<double>::infinity()}}) {
    EXPECT_TRUE(found(cells, x).empty());
  }
  EXPECT_TRUE(found(NearCells(), {}).empty());
  EXPECT_TRUE(found(NearCells({}, 1), {}).empty());
}

}  // namespace
}  // namespace deform::near_cells_test
