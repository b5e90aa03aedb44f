// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/kernels/polynomial.h"

#include <algorithm>

#include "core/base/parallel.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

constexpr double flat = 1e-6;       // of the extent: thinner hulls lose their dimension
constexpr double dependent = 1e-9;  // relative pivot below which a monomial depends on the others
struct Exponents {
  int x, y, z;
};
constexpr std::array<Exponents, 10> monomials{
    {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {2, 0, 0}, {1, 1, 0}, {1, 0, 1}, {0, 2, 0}, {0, 1, 1}, {0, 0, 2}}};

}  // namespace

/// Sets origin and axes from the centres and their images, and returns their largest distance from the origin.
double PolynomialSpace::find_axes(std::span<const Vec3> centres, const Parity& parity) {
  const auto m = static_cast<Eigen::Index>(centres.size());
  const auto mirrored = [&](int k) { return parity.sign[static_cast<std::size_t>(k)] != 0; };
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& c : centres) mean += Eigen::Map<const Eigen::Vector3d>(c.data());
  mean /= static_cast<double>(m);
  for (int k = 0; k < 3; ++k) {
    if (mirrored(k)) mean[k] = 0;
  }
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  double extent = 0;
  for (const auto& c : centres) {
    const Eigen::Vector3d d = Eigen::Map<const Eigen::Vector3d>(c.data()) - mean;
    scatter += d * d.transpose();
    extent = std::max(extent, d.norm());
  }
  for (int k = 0; k < 3; ++k) origin_[k] = mean[k];
  if (parity.none()) {
    const Eigen::Matrix3d U = svd(scatter).U;
    for (int k = 0; k < 3; ++k) {
      for (int i = 0; i < 3; ++i) axes_[k][i] = U(i, k);
    }
    return extent;
  }
  for (int k = 0; k < 3; ++k) axes_[k][k] = 1;
  for (int k = 0; k < 3; ++k) {
    const int a = (k + 1) % 3, b = (k + 2) % 3;
    if (!mirrored(k) || mirrored(a) || mirrored(b)) continue;
    Eigen::Matrix2d block;
    block << scatter(a, a), scatter(a, b), scatter(b, a), scatter(b, b);
    const Eigen::Matrix2d U = svd(block).U;
    axes_[a][a] = U(0, 0);
    axes_[a][b] = U(1, 0);
    axes_[b][a] = U(0, 1);
    axes_[b][b] = U(1, 1);
  }
  return extent;
}

PolynomialSpace::PolynomialSpace(std::span<const Vec3> centres, int degree, const Parity& parity) {
  if (degree < 0) return;
  const double extent = find_axes(centres, parity);
  // Extent along each axis from the points themselves: the scatter matrix has lost half of the digits.
  std::array<double, 3> widths{};
  for (int k = 0; k < 3; ++k) {
    for (const auto& c : centres) {
      double t = 0;
      for (int i = 0; i < 3; ++i) t += axes_[k][i] * (c[i] - origin_[i]);
      widths[k] = std::max(widths[k], std::abs(t));
    }
  }
  const auto wide = [&](int k) { return extent > 0 && widths[k] > flat * extent; };
  std::array<int, 3> sign{};
  if (parity.none()) {
    for (int k = 0; k < 3; ++k) {
      if (wide(k)) dimension_ = k + 1;
    }
  } else {
    // The axes keep their coordinates, those across which the hull is flat come last.
    std::array<int, 3> order{0, 1, 2};
    dimension_ = static_cast<int>(std::stable_partition(order.begin(), order.end(), wide) - order.begin());
    const std::array<Vec3, 3> axes = axes_;
    for (std::size_t k = 0; k < 3; ++k) {
      axes_[k] = axes[static_cast<std::size_t>(order[k])];
      sign[k] = parity.sign[static_cast<std::size_t>(order[k])];
    }
  }
  scale_ = extent > 0 ? 1 / extent : 1;

  const auto allowed = [&](std::size_t axis, int exponent) {
    if (exponent > 0 && dimension_ <= static_cast<int>(axis)) return false;
    return sign[axis] == 0 || (exponent % 2 == 1) == (sign[axis] < 0);
  };
  std::vector<int> candidates;
  for (int t = 0; t < static_cast<int>(monomials.size()); ++t) {
    const Exponents& e = monomials[t];
    if (allowed(0, e.x) && allowed(1, e.y) && allowed(2, e.z) && e.x + e.y + e.z <= degree) candidates.push_back(t);
  }
  if (candidates.empty()) return;
  terms_ = candidates;
  const std::vector<Eigen::Index> independent = independent_columns(matrix(centres), dependent);
  terms_.clear();
  for (const Eigen::Index i : independent) terms_.push_back(candidates[i]);
  std::sort(terms_.begin(), terms_.end());
  dropped_ = candidates.size() - terms_.size();
}

Vec3 PolynomialSpace::local(const Vec3& x) const {
  Vec3 result{};
  for (int k = 0; k < dimension_; ++k) {
    for (int i = 0; i < 3; ++i) result[k] += axes_[k][i] * (x[i] - origin_[i]);
    result[k] *= scale_;
  }
  return result;
}

double PolynomialSpace::monomial(const Vec3& y, int term) const {
  const Exponents& e = monomials[term];
  double product = 1;
  for (int i = 0; i < e.x; ++i) product *= y[0];
  for (int i = 0; i < e.y; ++i) product *= y[1];
  for (int i = 0; i < e.z; ++i) product *= y[2];
  return product;
}

void PolynomialSpace::values(const Vec3& x, double* out) const {
  const Vec3 y = local(x);
  for (std::size_t t = 0; t < terms_.size(); ++t) out[t] = monomial(y, terms_[t]);
}

Eigen::MatrixXd PolynomialSpace::matrix(std::span<const Vec3> points) const {
  Eigen::MatrixXd P(points.size(), terms_.size());
  std::array<double, monomials.size()> row{};
  for (std::size_t i = 0; i < points.size(); ++i) {
    values(points[i], row.data());
    for (std::size_t t = 0; t < terms_.size(); ++t) P(i, t) = row[t];
  }
  return P;
}

void add_polynomials(const PolynomialSpace& polynomials, std::span<const Vec3> points, std::span<const double> coefficients,
                     std::span<double> values, const RunContext& context) {
  const std::size_t q = polynomials.terms();
  if (q == 0) return;
  const std::size_t columns = coefficients.size() / q;
  parallel_for(context, points.size(), 4096, [&](std::size_t begin, std::size_t end) {
    std::array<double, monomials.size()> terms{};
    for (std::size_t i = begin; i < end; ++i) {
      polynomials.values(points[i], terms.data());
      for (std::size_t t = 0; t < q; ++t) {
        for (std::size_t c = 0; c < columns; ++c) values[i * columns + c] += terms[t] * coefficients[t * columns + c];
      }
    }
  });
}

}  // namespace deform
