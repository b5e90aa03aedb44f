// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 8.3.3: linear moving least squares. The reference is the definition written out with complex numbers.
#include "core/numerics/sampling/mls_basis.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <memory>
#include <numbers>
#include <set>
#include <vector>

#include "tests/core/numerics/random_points.h"
#include "tests/support/expect_error.h"

namespace deform::mls_basis_test {
namespace {

using Complex = std::complex<double>;
using Place = std::array<Complex, 3>;

/// The functions of the samples within the radius of x, from the 4 x 4 moment matrix with monomials about `about` (thesis 8.3.3),
/// over the first `dimension` coordinates.
std::vector<Complex> reference(const std::vector<Vec3>& samples, const std::vector<std::uint32_t>& active, const Place& x,
                               const Vec3& about, double radius, int dimension) {
  const int terms = dimension + 1;
  Eigen::MatrixXcd M = Eigen::MatrixXcd::Zero(terms, terms);
  Eigen::VectorXcd at(terms);
  at[0] = 1;
  for (int k = 0; k < dimension; ++k) at[k + 1] = x[k] - about[static_cast<std::size_t>(k)];
  std::vector<Eigen::VectorXcd> p;
  std::vector<Complex> w;
  for (const std::uint32_t j : active) {
    Complex square = 0;
    for (std::size_t k = 0; k < 3; ++k) square += (x[k] - samples[j][k]) * (x[k] - samples[j][k]);
    w.push_back(0.5 * std::cos(std::sqrt(square) * std::numbers::pi / radius) + 0.5);
    p.emplace_back(terms);
    p.back()[0] = 1;
    for (int k = 0; k < dimension; ++k) {
      p.back()[k + 1] = samples[j][static_cast<std::size_t>(k)] - about[static_cast<std::size_t>(k)];
    }
    M += w.back() * p.back() * p.back().transpose();
  }
  const Eigen::VectorXcd alpha = M.fullPivLu().solve(at);
  std::vector<Complex> values;
  for (std::size_t i = 0; i < w.size(); ++i) values.push_back(w[i] * (p[i].transpose() * alpha)(0));
  return values;
}

/// Samples of a wavy sheet, a line, ... and where to look.
struct Case {
  const char* name;
  int dimension;  ///< of the hull of the samples, in the first coordinates
  std::size_t samples;
  double radius;
};
std::ostream& operator<<(std::ostream& out, const Case& c) { return out << c.name; }

class MlsCase : public testing::TestWithParam<Case> {
 protected:
  std::vector<Vec3> flattened(std::vector<Vec3> points) const {
    for (Vec3& x : points) {
      for (std::size_t k = static_cast<std::size_t>(GetParam().dimension); k < 3; ++k) x[k] = 0;
    }
    return points;
  }
  const std::vector<Vec3> samples_ = flattened(test::random_points(GetParam().samples, 21));
  const std::vector<Vec3> points_ = flattened(test::random_points(60, 22));
  const MlsBasis basis_{samples_, GetParam().radius, {}};
};

TEST_P(MlsCase, AddUpToOneAndReproduceLinearFunctions) {
  const SparseRows values = basis_.values(points_);
  for (std::size_t i = 0; i < points_.size(); ++i) {
    double sum = 0;
    Vec3 place{};
    std::size_t count = 0;
    for (SparseRows::InnerIterator it(values, static_cast<Eigen::Index>(i)); it; ++it) {
      sum += it.value();
      ++count;
      for (std::size_t k = 0; k < 3; ++k) place[k] += it.value() * samples_[static_cast<std::size_t>(it.col())][k];
    }
    EXPECT_GE(count, 8u);
    EXPECT_NEAR(sum, 1, 1e-13);
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(place[k], points_[i][k], 1e-12);
  }
}

TEST_P(MlsCase, DerivativesOfLinearFunctions) {
  // Second derivatives of the functions are of the size of 1 / radius^2, here up to 100 of them at once.
  const double scale = 1 / (GetParam().radius * GetParam().radius);
  for (const Vec3& point : points_) {
    MlsBasis::Row row;
    basis_.evaluate(point, MlsBasis::Order::second, row);
    Eigen::Matrix<double, 4, 4> sums = Eigen::Matrix4d::Zero();  // of 1, x, y, z: d/dx, d/dy, d/dz, Laplacian
    for (std::size_t j = 0; j < row.samples.size(); ++j) {
      const Vec3 &x = samples_[row.samples[j]], &g = row.gradients[j];
      sums += Eigen::Vector4d(1, x[0], x[1], x[2]) * Eigen::RowVector4d(g[0], g[1], g[2], row.laplacian(j));
    }
    for (int k = 0; k < GetParam().dimension; ++k) sums(k + 1, k) -= 1;
    EXPECT_LT(sums.leftCols(3).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_LT(sums.col(3).cwiseAbs().maxCoeff(), 1e-12 * scale);
  }
}

TEST_P(MlsCase, DerivativesAgreeWithComplexSteps) {
  MlsBasis::Row row;
  std::size_t compared = 0;
  for (const Vec3& x : points_) {
    basis_.evaluate(x, MlsBasis::Order::second, row);
    ASSERT_EQ(static_cast<int>(row.rank), GetParam().dimension);
    // Near a rim the second derivative jumps, and so do differences across it.
    const double radius = basis_.radius(), step = 1e-3 * radius;
    const bool at_rim = std::any_of(samples_.begin(), samples_.end(), [&](const Vec3& c) {
      return std::abs(std::sqrt(test::squared_distance(x, c)) - radius) < 3 * step;
    });
    if (at_rim || row.near.size() < 8) continue;
    ++compared;
    const auto gradient = [&](int k, double shift) {  // by a complex step, at x + shift e_k
      Place at{x[0], x[1], x[2]};
      at[static_cast<std::size_t>(k)] += Complex(shift, 1e-30);
      auto values = reference(samples_, row.samples, at, x, radius, GetParam().dimension);
      for (Complex& value : values) value = value.imag() / 1e-30;
      return values;
    };
    const auto values = reference(samples_, row.samples, {x[0], x[1], x[2]}, x, radius, GetParam().dimension);
    std::vector<double> laplacian(row.samples.size(), 0.0);
    for (std::size_t i = 0; i < values.size(); ++i) EXPECT_NEAR(row.values[i], values[i].real(), 1e-11);
    for (int k = 0; k < GetParam().dimension; ++k) {
      const auto here = gradient(k, 0), a = gradient(k, -2 * step), b = gradient(k, -step), c = gradient(k, step),
                 d = gradient(k, 2 * step);
      for (std::size_t i = 0; i < here.size(); ++i) {
        EXPECT_NEAR(row.gradients[i][static_cast<std::size_t>(k)] * radius, here[i].real() * radius, 1e-10);
        laplacian[i] += ((a[i] - d[i]) + 8.0 * (c[i] - b[i])).real() / (12 * step);
      }
    }
    const double unit = radius * radius;
    for (std::size_t i = 0; i < laplacian.size(); ++i) EXPECT_NEAR(row.laplacian(i) * unit, laplacian[i] * unit, 1e-6);
    for (int k = GetParam().dimension; k < 3; ++k) {
      for (const Vec3& g : row.gradients) EXPECT_EQ(g[static_cast<std::size_t>(k)], 0);
    }
  }
  EXPECT_GT(compared, 20u);
}

INSTANTIATE_TEST_SUITE_P(Samples, MlsCase,
                         testing::Values(Case{"space", 3, 500, 0.3}, Case{"plane", 2, 300, 0.25}, Case{"line", 1, 60, 0.25}),
                         [](const auto& tested) { return std::string(tested.param.name); });

// A turned plane: the axes that are left out are found, not given.
TEST(MlsBasis, LeavesOutTheNormalOfAnyPlane) {
  const Vec3 u{0.6, 0.8, 0}, v{-0.48, 0.36, 0.8}, n{0.64, -0.48, 0.6};
  std::vector<Vec3> samples, points;
  for (const Vec3& x : test::random_points(300, 5)) {
    Vec3 at;
    for (std::size_t k = 0; k < 3; ++k) at[k] = 3 + x[0] * u[k] + x[1] * v[k];
    (samples.size() < 250 ? samples : points).push_back(at);
  }
  const MlsBasis basis(samples, 0.3, {});
  MlsBasis::Row row;
  for (const Vec3& x : points) {
    basis.evaluate(x, MlsBasis::Order::second, row);
    EXPECT_EQ(row.rank, 2u);
    Vec3 place{};
    for (std::size_t i = 0; i < row.samples.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) place[k] += row.values[i] * samples[row.samples[i]][k];
      const Vec3& g = row.gradients[i];
      EXPECT_NEAR(g[0] * n[0] + g[1] * n[1] + g[2] * n[2], 0, 1e-10);
    }
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(place[k], x[k], 1e-10);
  }
}

// Slightly curved: the third axis is kept until its variance is 1e-6 of all; linear functions are reproduced on both sides of
// that to what was left out.
TEST(MlsBasis, NearlyFlatSamples) {
  for (const double height : {1e-1, 1e-2, 1e-3, 1e-4, 1e-8, 1e-15}) {
    std::vector<Vec3> samples = test::random_points(300, 6), points = test::random_points(50, 7);
    const auto lift = [&](Vec3& x) { x[2] = height * (x[0] * x[0] + std::sin(5 * x[1])); };
    std::for_each(samples.begin(), samples.end(), lift);
    std::for_each(points.begin(), points.end(), lift);
    const MlsBasis basis(samples, 0.25, {});
    MlsBasis::Row row;
    for (const Vec3& x : points) {
      basis.evaluate(x, MlsBasis::Order::second, row);
      double z = 0, sum = 0;
      for (std::size_t i = 0; i < row.samples.size(); ++i) {
        sum += row.values[i];
        z += row.values[i] * samples[row.samples[i]][2];
        EXPECT_TRUE(std::isfinite(row.laplacian(i)));
      }
      EXPECT_NEAR(sum, 1, 1e-12);
      EXPECT_NEAR(z, x[2], row.rank == 3 ? 1e-10 : 1e-3 * 0.25);
    }
  }
}

TEST(MlsBasis, EveryPlaceIsCovered) {
  std::vector<Vec3> samples = test::random_points(400, 8), points = test::random_points(3000, 9);
  points.push_back({0, 0, 0});
  const PointTree tree(samples);
  const CoverOptions options{.cover = 12};
  const double radius = covering_radius(tree, points, options);
  for (const Vec3& x : points) EXPECT_LT(std::sqrt(tree.kth_square(x, 12)), radius);
  // A stray point does not make everybody's supports larger, and is covered by supports of its own.
  points.push_back({5, 5, 5});
  EXPECT_LT(covering_radius(tree, points, options), 2 * radius);
  const MlsBasis basis(samples, covering_radius(tree, points, options), {.cover = options});
  const auto sizes = basis.row_sizes(points);
  EXPECT_GE(*std::min_element(sizes.begin(), sizes.end()), 12u);
  const SparseRows values = basis.values(points);
  EXPECT_NEAR((values * Eigen::VectorXd::Ones(400)).cwiseAbs().maxCoeff(), 1, 1e-9);
}

TEST(MlsBasis, NoNansAtSamplesAndWithFewOfThem) {
  const std::vector<std::vector<Vec3>> sets{{{1, 2, 3}}, {{1, 2, 3}, {1, 2, 4}}, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  for (const auto& samples : sets) {
    const MlsBasis basis(samples, 0.5, {});
    MlsBasis::Row row;
    std::vector<Vec3> points = samples;
    points.push_back({1.1, 2.2, 3.3});
    points.push_back({-7, 0, 0});
    for (const Vec3& x : points) {
      basis.evaluate(x, MlsBasis::Order::second, row);
      EXPECT_EQ(row.samples.size(), samples.size());
      double sum = 0;
      for (std::size_t i = 0; i < row.samples.size(); ++i) {
        sum += row.values[i];
        for (const double h : row.hessians[i]) EXPECT_TRUE(std::isfinite(h));
        for (const double g : row.gradients[i]) EXPECT_TRUE(std::isfinite(g));
      }
      EXPECT_NEAR(sum, 1, 1e-12);
    }
  }
}

TEST(MlsBasis, SameForAnyNumberOfThreads) {
  const auto samples = test::random_points(500, 1), points = test::random_points(2000, 2);
  const MlsBasis basis(samples, 0.25, {});
  RunContext one, two;
  one.threads = 1;
  two.threads = 2;
  const SparseRows a = basis.values(points, one), b = basis.values(points, two);
  ASSERT_EQ(a.nonZeros(), b.nonZeros());
  EXPECT_TRUE(std::equal(a.valuePtr(), a.valuePtr() + a.nonZeros(), b.valuePtr()));
  for (Eigen::Index i = 0; i < a.rows(); ++i) {
    for (auto p = a.outerIndexPtr()[i] + 1; p < a.outerIndexPtr()[i + 1]; ++p) {
      ASSERT_LT(a.innerIndexPtr()[p - 1], a.innerIndexPtr()[p]);
    }
  }
}

TEST(MlsBasis, BadInput) {
  test::expect_error(ErrorCode::invalid_argument, {"samples"}, [] { MlsBasis({}, 1, {}); });
  const std::vector<Vec3> one{{0, 0, 0}};
  test::expect_error(ErrorCode::invalid_argument, {"radius"}, [&] { MlsBasis(one, 0, {}); });
}

/// Every second sample is farther than it looks, every fifth out of reach.
class SomeFarther : public SampleReach {
 public:
  bool lengthens(const Vec3& /*x*/, std::span<const PointTree::Near> /*near*/) const override { return true; }
  void lengthen(const Vec3& /*x*/, std::span<const PointTree::Near> near, std::vector<double>& distances) const override {
    distances.clear();
    for (const auto& found : near) distances.push_back(counted(found.point, std::sqrt(found.square)));
  }
  static double counted(std::uint32_t sample, double distance) {
    if (sample % 5 == 0) return std::numeric_limits<double>::infinity();
    return sample % 2 == 0 ? 1.25 * distance : distance;
  }
};

TEST(MlsBasis, DistancesThatCountDecideTheWeights) {
  const std::vector<Vec3> samples = test::random_points(400, 11);
  const double radius = 0.35;
  MlsBasis::Options options;
  options.reach = std::make_shared<const SomeFarther>();
  const MlsBasis basis(samples, radius, options);
  MlsBasis::Row row;
  for (const Vec3& x : {Vec3{0.5, 0.5, 0.5}, {0.4, 0.6, 0.55}}) {
    basis.evaluate(x, MlsBasis::Order::second, row);
    Eigen::Matrix4d M = Eigen::Matrix4d::Zero();
    std::vector<Eigen::Vector4d> p;
    std::vector<double> w;
    std::vector<std::uint32_t> active;
    for (std::uint32_t j = 0; j < samples.size(); ++j) {
      const Vec3& c = samples[j];
      const double d = SomeFarther::counted(j, std::sqrt(test::squared_distance(x, c)));
      if (!(d < radius)) continue;
      active.push_back(j);
      p.emplace_back(1, c[0] - x[0], c[1] - x[1], c[2] - x[2]);
      w.push_back(0.5 * std::cos(std::numbers::pi * d / radius) + 0.5);
      M += w.back() * p.back() * p.back().transpose();
    }
    ASSERT_GE(active.size(), 8u);
    ASSERT_EQ(row.samples, active);
    const Eigen::Vector4d alpha = M.fullPivLu().solve(Eigen::Vector4d(1, 0, 0, 0));
    Eigen::Vector3d along = Eigen::Vector3d::Zero();
    double bent = 0;
    for (std::size_t i = 0; i < active.size(); ++i) {
      EXPECT_NEAR(row.values[i], w[i] * p[i].dot(alpha), 1e-11);
      const double linear = 2 * samples[active[i]][0] - 3 * samples[active[i]][2];
      for (int k = 0; k < 3; ++k) along[k] += linear * row.gradients[i][static_cast<std::size_t>(k)];
      for (std::size_t k = 0; k < 6; ++k) bent += linear * row.hessians[i][k];
    }
    EXPECT_LT((along - Eigen::Vector3d(2, 0, -3)).norm(), 1e-10);
    EXPECT_NEAR(bent, 0, 1e-8);
  }
}

}  // namespace
}  // namespace deform::mls_basis_test
