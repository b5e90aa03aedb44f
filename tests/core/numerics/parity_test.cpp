// SPDX-License-Identifier: GPL-3.0-or-later
// Kernels with mirror images: against plain sums over the images, and systems against those of all images.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/kernels/residual.h"
#include "core/numerics/kernels/tiles.h"
#include "tests/core/numerics/every_target.h"
#include "tests/core/numerics/random_points.h"
#include "tests/support/expect_error.h"

namespace deform::parity_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

const std::vector<Parity>& parities() {
  static const std::vector<Parity> all = {{{1, 0, 0}},  {{0, -1, 0}}, {{1, 1, 0}},  {{-1, 0, 1}},
                                          {{0, 1, -1}}, {{1, 1, 1}},  {{1, -1, 1}}, {{1, 1, -1}}};
  return all;
}

/// Every image of every centre, image by image.
std::vector<Vec3> with_images(const std::vector<Vec3>& centres, const Images& images) {
  std::vector<Vec3> all;
  for (std::size_t g = 0; g < images.count; ++g) {
    for (const Vec3& c : centres) all.push_back(images.at[g].of(c));
  }
  return all;
}

TEST(Parity, SumsOverTheImagesOnEveryTarget) {
  auto points = test::random_points(tile_size, 1);
  const auto centres = test::random_points(21, 2);
  test::on_every_target([&] {
    for (RadialKernel kernel : test::all_kernels()) {
      for (const Parity& parity : parities()) {
        kernel.parity = parity;
        const Images images(parity);
        for (std::size_t k = 0; k < 3; ++k) points[0][k] = parity.sign[k] < 0 ? 0 : points[1][k];
        const TiledPoints tiled(points);
        std::vector<double> got(centres.size() * tile_size);
        tile_kernel(kernel, tiled.tile(0), centres, got.data());
        for (std::size_t j = 0; j < centres.size(); ++j) {
          for (std::size_t i = 0; i < tile_size; ++i) {
            double expected = 0, size = 1;
            for (std::size_t g = 0; g < images.count; ++g) {
              const double r2 = test::squared_distance(points[i], images.at[g].of(centres[j]));
              expected += images.at[g].sign * value(kernel, r2);
              size += std::abs(value(kernel, r2));
            }
            EXPECT_NEAR(got[j * tile_size + i], expected, 1e-14 * size) << properties(kernel.kernel).name;
            EXPECT_NEAR(value(kernel, points[i], centres[j]), value(kernel, centres[j], points[i]), 1e-14 * size);
          }
          if (*std::min_element(parity.sign.begin(), parity.sign.end()) < 0) {
            EXPECT_EQ(got[j * tile_size], 0) << "on the plane of an odd kernel";
          }
        }
      }
    }
  });
}

TEST(Parity, ResidualIsThatOfAllImages) {
  const auto centres = test::random_points(40, 3);
  const auto values = test::random_values(40 * 2, 4);
  const MatrixXd W = Eigen::Map<const MatrixXd>(values.data(), 40, 2), none(40, 0);
  for (RadialKernel kernel : test::all_kernels()) {
    for (const Parity& parity : parities()) {
      const Images images(parity);
      const std::vector<Vec3> all = with_images(centres, images);
      const auto n = static_cast<Index>(all.size());
      MatrixXd weights(n, 2);
      for (std::size_t g = 0; g < images.count; ++g) weights.middleRows(40 * static_cast<Index>(g), 40) = images.at[g].sign * W;
      const MatrixXd expected = accurate_residual(kernel, all, all, MatrixXd(n, 0), weights, MatrixXd::Zero(n, 2), {});
      RadialKernel mirrored = kernel;
      mirrored.parity = parity;
      test::on_every_target([&] {
        const MatrixXd got = accurate_residual(mirrored, centres, centres, none, W, MatrixXd::Zero(40, 2), {});
        EXPECT_LT((got - expected.topRows(40)).cwiseAbs().maxCoeff(), 1e-14 * expected.cwiseAbs().maxCoeff());
      });
    }
  }
}

TEST(Parity, PolynomialsOfEveryParity) {
  auto centres = test::random_points(60, 5);
  struct Row {
    Parity parity;
    std::size_t linear, quadratic;
  };
  const Row table[] = {{{{1, 0, 0}}, 3, 7},  {{{-1, 0, 0}}, 1, 3}, {{{0, 1, 1}}, 2, 5},
                       {{{0, -1, 1}}, 1, 2}, {{{1, 1, 1}}, 1, 4},  {{{1, 1, -1}}, 1, 1}};
  for (const Row& row : table) {
    EXPECT_EQ(PolynomialSpace(centres, 1, row.parity).terms(), row.linear);
    EXPECT_EQ(PolynomialSpace(centres, 2, row.parity).terms(), row.quadratic);
    const PolynomialSpace space(centres, 2, row.parity);
    for (std::size_t k = 0; k < 3; ++k) {
      if (row.parity.sign[k] == 0) continue;
      Vec3 mirrored = centres[7];
      mirrored[k] = -mirrored[k];
      double here[10], there[10];
      space.values(centres[7], here);
      space.values(mirrored, there);
      for (std::size_t t = 0; t < space.terms(); ++t) EXPECT_EQ(there[t], row.parity.sign[k] * here[t]);
    }
  }
  EXPECT_EQ(PolynomialSpace(centres, 0, {{-1, 0, 0}}).terms(), 0u);
  // In the plane of reflection nothing tells squares of the normal coordinate from nothing, nor across another plane.
  for (Vec3& c : centres) c[0] = 0;
  EXPECT_EQ(PolynomialSpace(centres, 2, {{1, 0, 0}}).terms(), 6u);
  EXPECT_EQ(PolynomialSpace(centres, 2, {{1, 0, 0}}).hull_dimension(), 2);
  EXPECT_EQ(PolynomialSpace(centres, 2, {{0, 0, -1}}).terms(), 2u);
  for (Vec3& c : centres) c = {c[1], c[2], 2 * c[1] - c[2]};
  EXPECT_EQ(PolynomialSpace(centres, 1, {}).hull_dimension(), 2);
  EXPECT_EQ(PolynomialSpace(centres, 1, {{1, 0, 0}}).hull_dimension(), 3) << "a bent surface with its image";
}

TEST(Parity, EverySolverFindsTheInterpolantOfAllImages) {
  const auto centres = test::random_points(70, 6);
  MatrixXd F(70, 2);
  for (Index i = 0; i < 70; ++i) {
    const Vec3& x = centres[static_cast<std::size_t>(i)];
    F.row(i) << std::sin(2 * x[0] + x[1]) + x[2] * x[2], std::cos(x[1] - x[2]) * x[0];
  }
  const auto points = test::random_points(50, 7);
  for (const RadialKernel& kernel : test::all_kernels()) {
    InterpolationOptions options;
    options.kernel = kernel;
    options.polynomial_degree = std::max(1, properties(kernel.kernel).order - 1);
    for (const Parity& parity : parities()) {
      const Images images(parity);
      const std::vector<Vec3> all = with_images(centres, images);
      // Values of that parity: odd ones go to zero at the plane.
      MatrixXd data(all.size(), 2), half_data = F;
      for (Index i = 0; i < 70; ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
          if (parity.sign[k] < 0) half_data.row(i) *= std::sin(centres[static_cast<std::size_t>(i)][k]);
        }
      }
      for (std::size_t g = 0; g < images.count; ++g)
        data.middleRows(70 * static_cast<Index>(g), 70) = images.at[g].sign * half_data;
      options.kernel.parity = {};
      options.solver = Solver::ldlt;
      const auto whole = make_interpolator(all, options, {});
      const auto expected = whole->values(whole->interpolate(data, 0), points, {});
      options.kernel.parity = parity;
      for (const Solver solver : {Solver::cholesky, Solver::ldlt}) {
        options.solver = solver;
        const auto half = make_interpolator(centres, options, {});
        const auto got = half->values(half->interpolate(half_data, 0), points, {});
        for (std::size_t i = 0; i < got.size(); ++i) {
          EXPECT_NEAR(got[i], expected[i], 1e-9) << properties(kernel.kernel).name << " " << to_string(solver);
        }
      }
    }
  }
  InterpolationOptions iterative;
  iterative.kernel.parity = {{1, 0, 0}};
  iterative.solver = Solver::iterative;
  test::expect_error(ErrorCode::invalid_argument, {"iterative", "images"}, [&] { make_interpolator(centres, iterative, {}); });
}

}  // namespace
}  // namespace deform::parity_test
