// SPDX-License-Identifier: GPL-3.0-or-later
// The sums of whatever instructions this machine has against std::fma, term by term.
#include "core/compiled/field_sums.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "core/compiled/content.h"

namespace deform::compiled::field_sums_test {
namespace {

std::vector<double> random_numbers(std::size_t count, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> numbers(count);
  for (double& x : numbers) x = normal(random);
  return numbers;
}

TEST(FieldSums, RoundOncePerTerm) {
  constexpr std::size_t fields = 21;
  const std::vector<double> tile = random_numbers(fields * tile_points, 1);
  const std::vector<std::uint32_t> rows{0, 1, 4, 5, 9, 20};
  for (std::size_t columns = 1; columns < 50; ++columns) {
    const std::vector<double> B = random_numbers(fields * columns, columns);
    std::vector<double> out(columns * tile_points);
    field_sums(tile.data(), rows, B.data(), columns, columns, out.data());
    for (std::size_t c = 0; c < columns; ++c) {
      for (std::size_t i = 0; i < tile_points; ++i) {
        double sum = 0;
        for (const std::uint32_t r : rows) sum = std::fma(tile[r * tile_points + i], B[r * columns + c], sum);
        EXPECT_EQ(out[c * tile_points + i], sum) << columns << " columns, column " << c << ", point " << i;
      }
    }
  }
}

TEST(FieldSums, ProductsAreAddedInPlace) {
  constexpr std::size_t fields = 5;
  const std::vector<double> tile = random_numbers(fields * tile_points, 1), X = random_numbers(3 * tile_points, 2);
  const std::vector<double> before = random_numbers(fields * 3 * tile_points, 3);
  std::vector<double> sums = before;
  add_products(tile.data(), fields, X.data(), sums.data());
  for (std::size_t j = 0; j < sums.size(); ++j) {
    const std::size_t f = j / (3 * tile_points), c = j / tile_points % 3, i = j % tile_points;
    EXPECT_EQ(sums[j], std::fma(tile[f * tile_points + i], X[c * tile_points + i], before[j])) << j;
  }
}

}  // namespace
}  // namespace deform::compiled::field_sums_test
