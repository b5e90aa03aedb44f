// SPDX-License-Identifier: GPL-3.0-or-later
// Differences between close centres: their algebra, their kernel values against long double, and systems of boundary layers
// against elimination with 113 bits.
#include "core/numerics/interpolation/difference_basis.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stop_token>
#include <utility>
#include <vector>

#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/numerics/kernels/residual.h"
#include "tests/core/numerics/every_target.h"
#include "tests/core/numerics/random_points.h"
#include "tests/support/expect_error.h"

namespace deform::difference_basis_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

/// Columns of points over the unit square, with cells that grow by 1.3 from the first one on; a little curved.
std::vector<Vec3> boundary_layer(std::size_t columns, int layers, double first) {
  std::vector<Vec3> centres;
  for (const Vec3& x : test::random_points(columns, 8)) {
    for (int layer = 0; layer < layers; ++layer) {
      centres.push_back({x[0], x[1], 0.1 * x[0] * x[1] + first * (std::pow(1.3, layer) - 1) / 0.3});
    }
  }
  return centres;
}

MatrixXd smooth_values(const std::vector<Vec3>& points) {
  MatrixXd F(points.size(), 2);
  for (Index i = 0; i < F.rows(); ++i) {
    const Vec3& x = points[static_cast<std::size_t>(i)];
    F.row(i) << std::sin(3 * x[0]) + x[1], std::cos(2 * x[1] - x[2]);
  }
  return F;
}

TEST(DifferenceBasis, HasTheNearestOfTheOnesBefore) {
  auto centres = test::random_points(60, 3);
  for (std::size_t i = 0; i < 25; ++i) centres.push_back({centres[i][0], centres[i][1] + 1e-3, centres[i][2]});
  for (std::size_t i = 0; i < 10; ++i) centres.push_back({centres[i][0], centres[i][1] + 1.2e-3, centres[i][2]});
  const DifferenceBasis basis(centres, {});
  EXPECT_EQ(basis.size(), 35u);
  const auto& parents = basis.parents();
  for (std::size_t i = 0; i < centres.size(); ++i) {
    if (parents[i] == DifferenceBasis::none) continue;
    EXPECT_LT(std::sqrt(test::squared_distance(centres[i], centres[parents[i]])), 1.3e-3);
    std::size_t steps = 0;
    for (auto p = parents[i]; p != DifferenceBasis::none; p = parents[p]) ASSERT_LT(++steps, 3u) << "no cycles";
  }
  for (std::size_t i = 0; i < 60; ++i) {  // of each cluster one is itself
    std::vector<std::size_t> members{i};
    if (i < 25) members.push_back(60 + i);
    if (i < 10) members.push_back(85 + i);
    EXPECT_EQ(std::count_if(members.begin(), members.end(), [&](std::size_t k) { return parents[k] == DifferenceBasis::none; }),
              1)
        << i;
  }
}

TEST(DifferenceBasis, AppliesTheMatrixAndItsTranspose) {
  const auto centres = boundary_layer(9, 5, 1e-4);
  const auto m = static_cast<Index>(centres.size());
  const DifferenceBasis basis(centres, {});
  EXPECT_GE(basis.size(), 36u);
  MatrixXd T = MatrixXd::Identity(m, m);
  for (Index i = 0; i < m; ++i) {
    const auto p = basis.parents()[static_cast<std::size_t>(i)];
    if (p != DifferenceBasis::none) T(i, static_cast<Index>(p)) = -1;
  }
  const auto values = test::random_values(static_cast<std::size_t>(m + 2) * 3, 5);
  const MatrixXd F = Eigen::Map<const MatrixXd>(values.data(), m + 2, 3);  // rows beyond the centres stay
  MatrixXd differences = F, weights = F;
  basis.apply(differences);
  basis.apply_transposed(weights);
  EXPECT_EQ(differences.topRows(m), T * F.topRows(m));
  EXPECT_LT((weights.topRows(m) - T.transpose() * F.topRows(m)).cwiseAbs().maxCoeff(), 1e-14);
  EXPECT_EQ(differences.bottomRows(2), F.bottomRows(2));
  EXPECT_EQ(weights.bottomRows(2), F.bottomRows(2));
}

TEST(DifferenceBasis, StopsWhenAsked) {
  std::stop_source stop;
  stop.request_stop();
  RunContext cancelled;
  cancelled.stop = stop.get_token();
  test::expect_error(ErrorCode::cancelled, {}, [&] { DifferenceBasis(test::random_points(10, 1), cancelled); });
}

__extension__ typedef __float128 Quad;

Quad square_root(Quad square) {
  if (square == 0) return 0;
  Quad root = std::sqrt(static_cast<long double>(square));
  return (root + square / root) / 2;  // one Newton step doubles the digits
}

Quad quad_square(const Vec3& a, const Vec3& b) {
  Quad square = 0;
  for (std::size_t k = 0; k < 3; ++k) square += (Quad(a[k]) - Quad(b[k])) * (Quad(a[k]) - Quad(b[k]));
  return square;
}

Quad cube(const Vec3& a, const Vec3& b) {
  const Quad square = quad_square(a, b);
  return square * square_root(square);
}

TEST(DifferenceBasis, ColumnsHaveTheirDigits) {
  auto points = boundary_layer(4, 5, 1e-6);
  points.resize(19);  // not whole tiles
  const Vec3 centre = points[2], near = points[3];
  const TiledPoints tiled(points);
  const auto value = [](Kernel kernel, const Vec3& a, const Vec3& b) {
    const Quad square = quad_square(a, b), root = square_root(square);
    return kernel == Kernel::biharmonic ? root : square * root * (kernel == Kernel::quintic ? square : Quad(1));
  };
  for (const Kernel kernel : {Kernel::triharmonic, Kernel::biharmonic, Kernel::quintic}) {
    for (const Vec3* other : {static_cast<const Vec3*>(nullptr), &near}) {
      test::on_every_target([&] {
        std::vector<double> high(tiled.tiles() * tile_size), low(high.size());
        accurate_column({kernel, 1}, tiled, centre, other, high.data(), low.data());
        for (std::size_t i = 0; i < points.size(); ++i) {
          const Quad expected =
              value(kernel, points[i], centre) - (other != nullptr ? value(kernel, points[i], *other) : Quad(0));
          const Quad error = Quad(high[i]) + Quad(low[i]) - expected;
          EXPECT_LT(std::abs(static_cast<double>(error)), 1e-29) << i;
        }
      });
    }
  }
}

/// Weights and coefficients of degree 1 by elimination, row by row of [Phi P f; P^T 0 0].
std::vector<std::vector<Quad>> eliminated(const std::vector<Vec3>& centres, const MatrixXd& P, const MatrixXd& F) {
  const std::size_t m = centres.size(), q = static_cast<std::size_t>(P.cols()), n = m + q,
                    columns = static_cast<std::size_t>(F.cols());
  std::vector<std::vector<Quad>> A(n, std::vector<Quad>(n + columns, 0));
  for (std::size_t i = 0; i < m; ++i) {
    for (std::size_t j = 0; j < m; ++j) A[i][j] = cube(centres[i], centres[j]);
    for (std::size_t t = 0; t < q; ++t) A[i][m + t] = A[m + t][i] = P(static_cast<Index>(i), static_cast<Index>(t));
    for (std::size_t c = 0; c < columns; ++c) A[i][n + c] = F(static_cast<Index>(i), static_cast<Index>(c));
  }
  const auto size = [](Quad x) { return x < 0 ? -x : x; };
  for (std::size_t k = 0; k < n; ++k) {
    const auto pivot = std::max_element(A.begin() + static_cast<std::ptrdiff_t>(k), A.end(),
                                        [&](const auto& a, const auto& b) { return size(a[k]) < size(b[k]); });
    std::swap(A[k], *pivot);
    for (std::size_t i = k + 1; i < n; ++i) {
      const Quad factor = A[i][k] / A[k][k];
      for (std::size_t j = k; j < n + columns; ++j) A[i][j] -= factor * A[k][j];
    }
  }
  std::vector<std::vector<Quad>> X(n, std::vector<Quad>(columns, 0));
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t c = 0; c < columns; ++c) {
      Quad sum = A[k][n + c];
      for (std::size_t j = k + 1; j < n; ++j) sum -= A[k][j] * X[j][c];
      X[k][c] = sum / A[k][k];
    }
  }
  return X;
}

TEST(DifferenceBasis, BoundaryLayersKeepTheirDigits) {
  for (const auto& [first, layers] : {std::pair{2e-5, 6}, std::pair{1e-6, 6}, std::pair{1e-7, 4}, std::pair{1e-8, 4}}) {
    SCOPED_TRACE(first);
    const double limit = 10 * 2.2e-16 / first;  // weights are that large, and sums are of doubles
    const auto centres = boundary_layer(30, layers, first);
    const MatrixXd F = smooth_values(centres);
    for (const Solver solver : {Solver::automatic, Solver::ldlt}) {
      InterpolationOptions options;
      options.solver = solver;
      const DenseInterpolator system(centres, options, {});
      EXPECT_EQ(system.solver(), Solver::ldlt);
      EXPECT_LT(system.condition(), 1e15);
      EXPECT_GT(factor_ldlt({system.kernel(), centres, system.polynomials()}, {})->condition(), 1e15)
          << "else this shows nothing";
      const Interpolants found = system.interpolate(F, 0);
      EXPECT_TRUE(found.converged || first < 1e-7) << "sums of doubles with weights over 1e7 do not settle to 1e-8 of them";
      // Within the layers, right above them, and away.
      std::vector<Vec3> places = boundary_layer(15, 3, 1.7 * first);
      for (const Vec3& x : test::random_points(20, 9)) places.push_back(x);
      const MatrixXd P = system.polynomials().matrix(centres), at = system.polynomials().matrix(places);
      const auto X = eliminated(centres, P, F);
      const std::vector<double> values = system.direct_values(found, places);
      for (std::size_t i = 0; i < places.size(); ++i) {
        for (std::size_t c = 0; c < 2; ++c) {
          Quad expected = 0;
          for (std::size_t j = 0; j < centres.size(); ++j) expected += X[j][c] * cube(places[i], centres[j]);
          for (Index t = 0; t < at.cols(); ++t)
            expected += X[centres.size() + static_cast<std::size_t>(t)][c] * Quad(at(static_cast<Index>(i), t));
          EXPECT_NEAR(values[2 * i + c], static_cast<double>(expected), limit) << i;
        }
      }
    }
  }
}

}  // namespace
}  // namespace deform::difference_basis_test
