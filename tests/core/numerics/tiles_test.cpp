// SPDX-License-Identifier: GPL-3.0-or-later
// Vectorized loops against plain ones, on every instruction set of this machine; independence of place, grouping and threads.
#include "core/numerics/kernels/tiles.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/base/error.h"
#include "tests/core/numerics/every_target.h"
#include "tests/core/numerics/random_points.h"

namespace deform::tiles_test {
namespace {

TEST(Tiles, KernelValuesOnEveryTarget) {
  const auto points = test::random_points(tile_size, 1);
  auto centres = test::random_points(37, 2);
  centres[5] = points[3];  // distance 0
  const TiledPoints tiled(points);
  test::on_every_target([&] {
    for (const RadialKernel& kernel : test::all_kernels()) {
      std::vector<double> got(centres.size() * tile_size);
      tile_kernel(kernel, tiled.tile(0), centres, got.data());
      for (std::size_t j = 0; j < centres.size(); ++j) {
        for (std::size_t i = 0; i < tile_size; ++i) {
          const double expected = value(kernel, test::squared_distance(points[i], centres[j]));
          // Kernels with a shape and logarithms near 1 are differences of numbers of size 1.
          const bool cancels = properties(kernel.kernel).has_shape || kernel.kernel == Kernel::thin_plate;
          const double size = cancels ? 1 : std::abs(expected);
          EXPECT_NEAR(got[j * tile_size + i], expected, 4e-15 * size) << properties(kernel.kernel).name;
        }
      }
    }
  });
}

TEST(Tiles, GaussianFarAwayIsZeroAndNotNoise) {
  std::vector<Vec3> points(tile_size, Vec3{1, 1, 1});
  const std::vector<Vec3> centres{{0, 0, 0}};
  const TiledPoints tiled(points);
  test::on_every_target([&] {
    std::vector<double> got(tile_size);
    tile_kernel({Kernel::gaussian, 1e-3}, tiled.tile(0), centres, got.data());
    for (const double v : got) {
      EXPECT_GE(v, 0.0);
      EXPECT_LT(v, 1e-300);
    }
  });
}

TEST(Tiles, ProductsOnEveryTarget) {
  constexpr std::size_t K = 83;
  for (const std::size_t columns : {1, 2, 3, 4, 6, 7, 9, 45, 80}) {
    const auto A = test::random_values(K * tile_size, 3);
    const auto B = test::random_values(K * columns, 4);
    const auto X = test::random_values(columns * tile_size, 5);
    test::on_every_target([&] {
      std::vector<double> out(columns * tile_size, 0.25);
      tile_product(A.data(), K, B.data(), columns, columns, out.data());
      std::vector<double> transposed(K * columns, 0.5);
      tile_product_transposed(A.data(), K, X.data(), columns, transposed.data(), columns);
      for (std::size_t c = 0; c < columns; ++c) {
        for (std::size_t i = 0; i < tile_size; ++i) {
          double sum = 0.25;
          for (std::size_t k = 0; k < K; ++k) sum += A[k * tile_size + i] * B[k * columns + c];
          EXPECT_NEAR(out[c * tile_size + i], sum, 1e-13);
        }
        for (std::size_t k = 0; k < K; ++k) {
          double sum = 0.5;
          for (std::size_t i = 0; i < tile_size; ++i) sum += A[k * tile_size + i] * X[c * tile_size + i];
          EXPECT_NEAR(transposed[k * columns + c], sum, 1e-14);
        }
      }
    });
  }
}

TEST(Tiles, ProductsOfSomeRowsLeaveTheOthersAlone) {
  constexpr std::size_t K = 29;
  const std::vector<std::uint32_t> rows{1, 2, 7, 20, 28};
  for (const std::size_t columns : {1, 3, 6, 10}) {
    auto A = test::random_values(K * tile_size, 3);
    auto B = test::random_values(K * columns, 4);
    std::vector<double> few_A, few_B;
    for (const std::uint32_t r : rows) {
      few_A.insert(few_A.end(), A.begin() + r * tile_size, A.begin() + (r + 1) * tile_size);
      few_B.insert(few_B.end(), B.begin() + static_cast<std::ptrdiff_t>(r * columns),
                   B.begin() + static_cast<std::ptrdiff_t>((r + 1) * columns));
    }
    for (std::size_t k = 0; k < K; ++k) {  // what is read shows
      if (std::find(rows.begin(), rows.end(), k) != rows.end()) continue;
      std::fill_n(A.begin() + static_cast<std::ptrdiff_t>(k * tile_size), tile_size, NAN);
    }
    test::on_every_target([&] {
      std::vector<double> out(columns * tile_size, 0.25), expected = out;
      tile_product(A.data(), K, rows, B.data(), columns, columns, out.data());
      tile_product(few_A.data(), rows.size(), few_B.data(), columns, columns, expected.data());
      EXPECT_TRUE(out == expected) << columns;
    });
  }
}

TEST(Tiles, ProductsOfAllRowsByNameAreThoseOfAllRows) {
  constexpr std::size_t K = 29;
  std::vector<std::uint32_t> rows(K);
  std::iota(rows.begin(), rows.end(), 0u);
  const auto A = test::random_values(K * tile_size, 3);
  for (const std::size_t columns : {0, 1, 2, 3, 6, 7, 9, 45}) {
    const auto B = test::random_values(K * columns, 4);
    test::on_every_target([&] {
      std::vector<double> out(columns * tile_size, 0.25), expected = out;
      tile_product(A.data(), K, rows, B.data(), columns, columns, out.data());
      tile_product(A.data(), K, B.data(), columns, columns, expected.data());
      EXPECT_TRUE(out == expected) << columns;
    });
  }
}

TEST(Tiles, PositionsOnEveryTarget) {
  const auto places = test::random_points(tile_size, 9);
  const auto values = test::random_values(3 * tile_size, 10);
  for (const double keep : {0.0, 1.0}) {
    test::on_every_target([&] {
      std::vector<Vec3> out(tile_size + 1, Vec3{7, 7, 7});
      tile_positions(places.data(), keep, values.data(), out.data());
      for (std::size_t i = 0; i < tile_size; ++i) {
        for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(out[i][k], keep * places[i][k] + values[k * tile_size + i]) << i;
      }
      EXPECT_EQ(out[tile_size], (Vec3{7, 7, 7})) << "written beyond the tile";
    });
  }
}

TEST(Tiles, GroupingOfColumnsDoesNotChangeABit) {
  constexpr std::size_t columns = 45;
  const auto centres = test::random_points(150, 6);
  const auto weights = test::random_values(centres.size() * columns, 7);
  const TiledPoints tiled(test::random_points(tile_size, 8));
  test::on_every_target([&] {
    std::vector<double> together(columns * tile_size, 0.0);
    tile_kernel_sums({}, tiled.tile(0), centres, weights.data(), columns, columns, together.data());
    for (std::size_t group : {1, 3, 5, 6, 15}) {
      std::vector<double> apart(columns * tile_size, 0.0);
      for (std::size_t c = 0; c < columns; c += group) {
        tile_kernel_sums({}, tiled.tile(0), centres, weights.data() + c, columns, std::min(group, columns - c),
                         apart.data() + c * tile_size);
      }
      EXPECT_TRUE(apart == together) << group;
    }
  });
}

TEST(Tiles, KernelSumsAgainstPlainLoops) {
  const auto points = test::random_points(101, 9);
  const auto centres = test::random_points(130, 10);
  for (const std::size_t columns : {1, 3, 8}) {
    const auto weights = test::random_values(centres.size() * columns, 11);
    for (const RadialKernel& kernel : test::all_kernels()) {
      const auto got = kernel_sums(kernel, points, centres, weights, columns, {});
      ASSERT_EQ(got.size(), points.size() * columns);
      for (std::size_t i = 0; i < points.size(); ++i) {
        for (std::size_t c = 0; c < columns; ++c) {
          double sum = 0, size = 0;
          for (std::size_t j = 0; j < centres.size(); ++j) {
            const double term = value(kernel, test::squared_distance(points[i], centres[j])) * weights[j * columns + c];
            sum += term;
            size += std::abs(term);
          }
          EXPECT_NEAR(got[i * columns + c], sum, 1e-14 * size);
        }
      }
    }
  }
}

TEST(Tiles, KernelSumsDoNotDependOnPlaceOrThreads) {
  const auto points = test::random_points(4001, 12);
  const auto centres = test::random_points(300, 13);
  const auto weights = test::random_values(centres.size() * 3, 14);
  const auto whole = kernel_sums({}, points, centres, weights, 3, {});
  for (const int threads : {1, 2}) {
    RunContext context;
    context.threads = threads;
    EXPECT_TRUE(kernel_sums({}, points, centres, weights, 3, context) == whole);
    for (const std::size_t begin : {1, 7, 16, 1000}) {
      const auto part = kernel_sums({}, std::span(points).subspan(begin, 333), centres, weights, 3, context);
      EXPECT_TRUE(std::equal(part.begin(), part.end(), whole.begin() + static_cast<std::ptrdiff_t>(3 * begin))) << begin;
    }
  }
}

TEST(Tiles, NothingIsFine) {
  EXPECT_TRUE(kernel_sums({}, {}, {}, {}, 3, {}).empty());
  EXPECT_EQ(TiledPoints(std::span<const Vec3>{}).tiles(), 0u);
  const auto points = test::random_points(3, 1);
  EXPECT_EQ(kernel_sums({}, points, {}, {}, 3, {}), std::vector<double>(9, 0.0));
}

TEST(Tiles, KernelSumsStopWhenCancelled) {
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  const auto points = test::random_points(100, 1);
  EXPECT_THROW(kernel_sums({}, points, points, std::vector<double>(100, 1.0), 1, context), Error);
}

}  // namespace
}  // namespace deform::tiles_test
