// The vectorized loops against the plain definitions, on every instruction set of this machine.
#include "core/numerics/tiles.h"

#include <gtest/gtest.h>

#include <hwy/targets.h>
#include <cmath>

#include "tests/core/numerics/sample_centres.h"

namespace deform {
namespace {

using test::all_kernels;
using test::distance2;
using test::random_points;

// Runs `body` once per instruction set, and puts the best one back.
template <typename Body>
void on_every_target(const Body& body) {
  const auto supported = hwy::SupportedTargets();
  int tried = 0;
  for (auto left = supported; left != 0; left &= left - 1) {
    hwy::SetSupportedTargetsForTest(left & ~(left - 1));
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    SCOPED_TRACE(vector_target());
    body();
    ++tried;
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  EXPECT_GE(tried, 1);
}

TEST(Tiles, TheLastTileIsFilledUp) {
  const Points points = random_points(35);
  const TiledPoints tiled(points);
  EXPECT_EQ(tiled.tiles(), 3u);
  for (std::size_t i = 0; i < 48; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_EQ(tiled.tile(i / tile_size)[k * tile_size + i % tile_size], points[std::min<std::size_t>(i, 34)][k]);
    }
  }
  EXPECT_EQ(TiledPoints(Points{}).tiles(), 0u);
}

TEST(Tiles, KernelsEqualTheirDefinitionOnEveryTarget) {
  Points points = random_points(64, 2);
  const Points centres = random_points(67, 3);
  points[5] = centres[3];  // distance 0
  for (Vec3& p : points) p[2] *= 3;
  const TiledPoints tiled(points);
  on_every_target([&] {
    for (const RadialKernel& kernel : all_kernels()) {
      std::vector<double> out(centres.size() * tile_size);
      for (std::size_t t = 0; t < tiled.tiles(); ++t) {
        tile_kernel(kernel, tiled.tile(t), centres, out.data());
        for (std::size_t j = 0; j < centres.size(); ++j) {
          for (std::size_t i = 0; i < tile_size; ++i) {
            const double expected = value(kernel, distance2(points[t * tile_size + i], centres[j]));
            EXPECT_NEAR(out[j * tile_size + i], expected, 4e-15 * std::max(1.0, std::abs(expected)))
                << properties(kernel.kernel).name;
          }
        }
      }
    }
  });
}

TEST(Tiles, KernelSumsEqualTheirDefinitionOnEveryTarget) {
  const Points points = random_points(83, 4);
  const Points centres = random_points(150, 5);
  std::vector<double> weights(centres.size() * 4);
  for (std::size_t i = 0; i < weights.size(); ++i) weights[i] = std::sin(static_cast<double>(i));
  on_every_target([&] {
    for (const RadialKernel& kernel : all_kernels()) {
      const std::vector<double> sums = kernel_sums(kernel, points, centres, weights, 4, {});
      for (std::size_t i = 0; i < points.size(); ++i) {
        for (std::size_t c = 0; c < 4; ++c) {
          double expected = 0, size = 0;
          for (std::size_t j = 0; j < centres.size(); ++j) {
            const double term = value(kernel, distance2(points[i], centres[j])) * weights[4 * j + c];
            expected += term;
            size += std::abs(term);
          }
          EXPECT_NEAR(sums[4 * i + c], expected, 1e-14 * size + 1e-300) << properties(kernel.kernel).name;
        }
      }
    }
  });
}

TEST(Tiles, ProductsDoNotDependOnTheGroupingOfColumns) {
  constexpr std::size_t K = 81, columns = 23;
  std::vector<double> A(K * tile_size), B(K * columns);
  for (std::size_t i = 0; i < A.size(); ++i) A[i] = std::sin(static_cast<double>(i));
  for (std::size_t i = 0; i < B.size(); ++i) B[i] = std::cos(static_cast<double>(i) * 0.7);
  on_every_target([&] {
    std::vector<double> together(columns * tile_size, 0.25);
    tile_product(A.data(), K, B.data(), columns, columns, together.data());
    for (std::size_t group = 1; group <= 8; ++group) {
      std::vector<double> grouped(columns * tile_size, 0.25);
      for (std::size_t c = 0; c < columns; c += group) {
        tile_product(A.data(), K, B.data() + c, columns, std::min(group, columns - c), grouped.data() + c * tile_size);
      }
      EXPECT_TRUE(together == grouped) << group;
    }
    for (std::size_t c = 0; c < columns; ++c) {
      for (std::size_t i = 0; i < tile_size; ++i) {
        double expected = 0.25;
        for (std::size_t k = 0; k < K; ++k) expected += A[k * tile_size + i] * B[k * columns + c];
        EXPECT_NEAR(together[c * tile_size + i], expected, 1e-13);
      }
    }
  });
}

TEST(Tiles, KernelSumsDoNotDependOnTheGroupingOfColumns) {
  constexpr std::size_t columns = 14;
  const Points centres = random_points(200, 6);
  const TiledPoints tiled(random_points(16, 7));
  std::vector<double> weights(centres.size() * columns);
  for (std::size_t i = 0; i < weights.size(); ++i) weights[i] = std::sin(static_cast<double>(i));
  on_every_target([&] {
    for (const RadialKernel& kernel : all_kernels()) {
      std::vector<double> together(columns * tile_size), grouped(columns * tile_size);
      tile_kernel_sums(kernel, tiled.tile(0), centres, weights.data(), columns, columns, together.data());
      for (std::size_t c = 0; c < columns; c += 3) {
        tile_kernel_sums(kernel, tiled.tile(0), centres, weights.data() + c, columns, std::min<std::size_t>(3, columns - c),
                         grouped.data() + c * tile_size);
      }
      EXPECT_TRUE(together == grouped) << properties(kernel.kernel).name;
    }
  });
}

TEST(Tiles, TransposedProductIsTheAdjoint) {
  constexpr std::size_t K = 37, columns = 3;
  std::vector<double> A(K * tile_size), X(columns * tile_size), out(K * columns, 1.0);
  for (std::size_t i = 0; i < A.size(); ++i) A[i] = std::sin(static_cast<double>(i));
  for (std::size_t i = 0; i < X.size(); ++i) X[i] = std::cos(static_cast<double>(i));
  on_every_target([&] {
    std::fill(out.begin(), out.end(), 1.0);
    tile_product_transposed(A.data(), K, X.data(), columns, out.data(), columns);
    for (std::size_t k = 0; k < K; ++k) {
      for (std::size_t c = 0; c < columns; ++c) {
        double expected = 1;
        for (std::size_t i = 0; i < tile_size; ++i) expected += A[k * tile_size + i] * X[c * tile_size + i];
        EXPECT_NEAR(out[k * columns + c], expected, 1e-14);
      }
    }
  });
}

TEST(Tiles, KernelSumsAreTheSameForAnyNumberOfThreads) {
  const Points points = random_points(20000, 8);
  const Points centres = random_points(100, 9);
  const std::vector<double> weights(300, 0.3);
  RunContext one;
  one.threads = 1;
  const RadialKernel kernel{Kernel::triharmonic, 1};
  EXPECT_TRUE(kernel_sums(kernel, points, centres, weights, 3, one) == kernel_sums(kernel, points, centres, weights, 3, {}));
}

TEST(Kernels, SignOnTheComplementIsAsStated) {
  for (const RadialKernel& kernel : all_kernels()) {
    const KernelProperties what = properties(kernel.kernel);
    EXPECT_GE(what.order, 0);
    EXPECT_LE(what.order, 3);
    EXPECT_EQ(std::abs(what.sign), 1);
    // Two points: weights 1, -1 annihilate constants, so the quadratic form is 2 phi(0) - 2 phi(r).
    if (what.order <= 1) {
      EXPECT_GT(what.sign * (2 * value(kernel, 0) - 2 * value(kernel, 0.04)), 0) << what.name;
    }
  }
}

}  // namespace
}  // namespace deform
