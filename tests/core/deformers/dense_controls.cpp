// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/core/deformers/dense_controls.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/deformers/setup.h"
#include "tests/support/linear_algebra.h"

namespace deform::test::dense_controls {

LatticeFunctions::LatticeFunctions(const LatticeOptions& options) : options_(options) {
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t n = options.points[k], degree = options.basis == LatticeBasis::bernstein ? n - 1 : 3;
    degrees_[k] = degree;
    for (std::size_t i = 0; i < n + degree + 1; ++i) {
      const Extended at = (static_cast<Extended>(i) - static_cast<Extended>(degree)) / static_cast<Extended>(n - degree);
      knots_[k].push_back(options.basis == LatticeBasis::uniform_cubic ? at : std::clamp<Extended>(at, 0, 1));
    }
  }
  Eigen::Matrix<Extended, 3, 3> axes;
  for (Eigen::Index k = 0; k < 3; ++k) {
    for (Eigen::Index l = 0; l < 3; ++l)
      axes(l, k) = options.frame->axes[static_cast<std::size_t>(k)][static_cast<std::size_t>(l)];
  }
  inverse_ = axes.inverse();
}

Place LatticeFunctions::rest(std::size_t number) const {
  const std::array<std::size_t, 3> ijk{number % options_.points[0], number / options_.points[0] % options_.points[1],
                                       number / options_.points[0] / options_.points[1]};
  Place x{};
  for (std::size_t l = 0; l < 3; ++l) x[l] = options_.frame->origin[l];
  for (std::size_t k = 0; k < 3; ++k) {
    Extended mean = 0;
    for (std::size_t i = 1; i <= degrees_[k]; ++i) mean += knots_[k][ijk[k] + i] / static_cast<Extended>(degrees_[k]);
    for (std::size_t l = 0; l < 3; ++l) x[l] += mean * options_.frame->axes[k][l];
  }
  return x;
}

std::vector<Extended> LatticeFunctions::values(const Vec3& x) const {
  std::array<std::vector<Extended>, 3> along;
  for (std::size_t k = 0; k < 3; ++k) {
    Extended u = 0;
    for (std::size_t l = 0; l < 3; ++l) {
      u += inverse_(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(l)) *
           (static_cast<Extended>(x[l]) - options_.frame->origin[l]);
    }
    if (u < -1e-12L || u > 1 + 1e-12L) return {};
    along[k] = splines(k, std::clamp<Extended>(u, 0, 1));
  }
  std::vector<Extended> result;
  for (const Extended c : along[2]) {
    for (const Extended b : along[1]) {
      for (const Extended a : along[0]) result.push_back(a * b * c);
    }
  }
  return result;
}

std::vector<Extended> LatticeFunctions::splines(std::size_t k, Extended u) const {
  const std::vector<Extended>& t = knots_[k];
  const std::size_t n = options_.points[k];
  std::size_t span = degrees_[k];
  while (span + 1 < n && u >= t[span + 1]) ++span;
  std::vector<Extended> value(t.size() - 1, 0);
  value[span] = 1;
  for (std::size_t d = 1; d <= degrees_[k]; ++d) {
    for (std::size_t i = 0; i + d + 1 < t.size(); ++i) {
      const Extended left = t[i + d] - t[i], right = t[i + d + 1] - t[i + 1];
      value[i] = (left > 0 ? (u - t[i]) / left * value[i] : 0) + (right > 0 ? (t[i + d + 1] - u) / right * value[i + 1] : 0);
    }
  }
  value.resize(n);
  return value;
}

std::vector<Extended> CageFunctions::values(const Vec3& x) const {
  const std::size_t n = options_.vertices.size();
  std::vector<Extended> distances(n), weights(n, 0);
  std::vector<Place> units(n);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < 3; ++k) units[i][k] = static_cast<Extended>(options_.vertices[i][k]) - x[k];
    distances[i] = length(units[i]);
    for (Extended& value : units[i]) value /= distances[i];
  }
  for (const auto& triangle : options_.triangles) add(triangle, units, distances, weights);
  Extended sum = 0;
  for (const Extended w : weights) sum += w;
  for (Extended& w : weights) w /= sum;
  return weights;
}

void CageFunctions::add(const std::array<std::uint32_t, 3>& triangle, const std::vector<Place>& units,
                        const std::vector<Extended>& distances, std::vector<Extended>& weights) {
  std::array<Extended, 3> theta{}, c{}, s{};
  Extended h = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const Place &a = units[triangle[(i + 1) % 3]], &b = units[triangle[(i + 2) % 3]];
    theta[i] = 2 * std::asin(length({a[0] - b[0], a[1] - b[1], a[2] - b[2]}) / 2);
    h += theta[i] / 2;
  }
  const Place &p = units[triangle[0]], &q = units[triangle[1]], &r = units[triangle[2]];
  const Extended det =
      p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0]) + p[2] * (q[0] * r[1] - q[1] * r[0]);
  for (std::size_t i = 0; i < 3; ++i) {
    c[i] = 2 * std::sin(h) * std::sin(h - theta[i]) / (std::sin(theta[(i + 1) % 3]) * std::sin(theta[(i + 2) % 3])) - 1;
    s[i] = std::copysign(std::sqrt(std::max<Extended>(0, 1 - c[i] * c[i])), det);
    if (s[i] == 0) return;
  }
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
    weights[triangle[i]] += (theta[i] - c[j] * theta[k] - c[k] * theta[j]) / (distances[triangle[i]] * std::sin(theta[j]) * s[k]);
  }
}

Place GreenOracle::displacement(const Vec3& x, const Matrix& moved) const {
  using V = Eigen::Matrix<Extended, 3, 1>;
  V result = V::Zero();
  for (const auto& triangle : options_.triangles) {
    std::array<V, 3> rest, p, now;
    for (std::size_t i = 0; i < 3; ++i) {
      for (Eigen::Index k = 0; k < 3; ++k) rest[i][k] = options_.vertices[triangle[i]][static_cast<std::size_t>(k)];
      now[i] = rest[i] + moved.row(static_cast<Eigen::Index>(triangle[i])).transpose();
      for (Eigen::Index k = 0; k < 3; ++k) p[i][k] = rest[i][k] - x[static_cast<std::size_t>(k)];
    }
    const V u = rest[1] - rest[0], v = rest[2] - rest[0], cross = u.cross(v);
    const V u1 = now[1] - now[0], v1 = now[2] - now[0];
    const Extended area = cross.norm() / 2, h = cross.dot(p[0]) / cross.norm();
    const V n = cross / cross.norm();
    const Extended a = p[0].norm(), b = p[1].norm(), c = p[2].norm();
    const Extended angle =
        2 * std::atan2(p[0].dot(p[1].cross(p[2])), a * b * c + p[0].dot(p[1]) * c + p[1].dot(p[2]) * a + p[2].dot(p[0]) * b);
    Extended single = -h * angle;
    V edges = V::Zero();
    for (std::size_t i = 0; i < 3; ++i) {
      const V &from = p[i], &to = p[(i + 1) % 3];
      const V along = (to - from).normalized(), outward = along.cross(n);
      const Extended log = std::log((to.norm() + along.dot(to)) / (from.norm() + along.dot(from)));
      single += outward.dot(from) * log;
      edges += outward * log;
    }
    for (std::size_t i = 0; i < 3; ++i) {
      const V opposite = p[(i + 2) % 3] - p[(i + 1) % 3], gradient = n.cross(opposite) / (2 * area);
      const Extended at_foot = gradient.dot(h * n - p[(i + 1) % 3]);
      result += (at_foot * angle - h * gradient.dot(edges)) * (now[i] - rest[i]);
    }
    const Extended stretch =
        std::sqrt(u1.squaredNorm() * v.squaredNorm() - 2 * u1.dot(v1) * u.dot(v) + v1.squaredNorm() * u.squaredNorm()) /
        (std::sqrt(8.0L) * area);
    result += single * (stretch * u1.cross(v1).normalized() - n);
  }
  result /= 4 * 3.14159265358979323846264338327950288L;
  return {result[0], result[1], result[2]};
}

Matrix damped(const Functions& functions, const std::vector<Vec3>& held, const Matrix& data, Extended damping) {
  std::vector<std::vector<std::pair<Eigen::Index, Extended>>> rows;
  Eigen::Index count = 0;
  for (const Vec3& x : held) {
    const std::vector<Extended> all = functions.values(x);
    count = std::max(count, static_cast<Eigen::Index>(all.size()));
    auto& row = rows.emplace_back();
    for (std::size_t j = 0; j < all.size(); ++j) {
      if (all[j] != 0) row.emplace_back(static_cast<Eigen::Index>(j), all[j]);
    }
  }
  const auto m = static_cast<Eigen::Index>(held.size());
  Matrix gram = Matrix::Zero(m, m), dense = Matrix::Zero(count, 1);
  for (Eigen::Index i = 0; i < m; ++i) {
    for (const auto& [j, value] : rows[static_cast<std::size_t>(i)]) dense(j, 0) = value;
    for (Eigen::Index l = 0; l < m; ++l) {
      for (const auto& [j, value] : rows[static_cast<std::size_t>(l)]) gram(i, l) += value * dense(j, 0);
    }
    for (const auto& [j, value] : rows[static_cast<std::size_t>(i)]) dense(j, 0) = 0;
  }
  const Extended largest = symmetric_eigenvalues(gram)[m - 1];
  for (Eigen::Index i = 0; i < m; ++i) gram(i, i) += damping * damping * largest;
  const Matrix loads = lu_solution(gram, data);
  Matrix result = Matrix::Zero(count, data.cols());
  for (Eigen::Index i = 0; i < m; ++i) {
    for (const auto& [j, value] : rows[static_cast<std::size_t>(i)]) result.row(j) += value * loads.row(i);
  }
  return result;
}

Matrix manipulated(const Functions& functions, const std::vector<Vec3>& held, const Matrix& data, std::size_t rank) {
  Matrix A;
  for (std::size_t i = 0; i < held.size(); ++i) {
    const std::vector<Extended> row = functions.values(held[i]);
    if (i == 0) A = Matrix::Zero(static_cast<Eigen::Index>(held.size()), static_cast<Eigen::Index>(row.size()));
    for (std::size_t j = 0; j < row.size(); ++j) A(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = row[j];
  }
  const ThinSvd<Extended> svd = thin_svd(A);
  const auto r = static_cast<Eigen::Index>(rank);
  const Matrix parts = svd.U.leftCols(r).transpose() * data;
  return svd.V.leftCols(r) * (parts.array().colwise() / svd.values.head(r).array()).matrix();
}

}  // namespace deform::test::dense_controls
