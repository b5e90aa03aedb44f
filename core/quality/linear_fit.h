// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/base/vectors.h"

// Least-squares linear maps on the few nodes of a cell, and floats on the safe side.

namespace deform::quality {

// Those of other types in this namespace hide them.
using deform::operator+;
using deform::operator-;
using deform::operator*;

/// To the float before or after, of what is not negative, and a little farther for the rounding before.
inline float rounded_down(double x) { return std::nextafter(static_cast<float>(x * (1 - 1e-6)), 0.0f); }
inline float rounded_up(double x) {
  return std::nextafter(static_cast<float>(x * (1 + 1e-6)), std::numeric_limits<float>::infinity());
}

using Matrix = std::array<Vec3, 3>;  // rows

/// a += b c^T
inline void add_product(Matrix& a, const Vec3& b, const Vec3& c) {
  for (std::size_t i = 0; i < 3; ++i) a[i] = a[i] + b[i] * c;
}

/// The inverse of a symmetric positive semidefinite matrix, regularized so that it exists for flat sets.
inline Matrix inverse_of_symmetric(Matrix m) {
  const double trace = m[0][0] + m[1][1] + m[2][2];
  for (std::size_t i = 0; i < 3; ++i) m[i][i] += 1e-14 * trace;
  const Matrix cofactors{cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])};
  const double determinant = dot(m[0], cofactors[0]);
  if (!(determinant > 0)) return {};
  return {(1 / determinant) * cofactors[0], (1 / determinant) * cofactors[1], (1 / determinant) * cofactors[2]};
}

inline Vec3 times(const Matrix& a, const Vec3& x) { return {dot(a[0], x), dot(a[1], x), dot(a[2], x)}; }

/// The weights with which values at places give the gradient of their least-squares linear fit: the sum of value times weight.
/// The weights add up to 0, so values may be relative to any one of them.
inline void fit_weights(std::span<const Vec3> places, std::vector<Vec3>& weights) {
  Vec3 mean{};
  for (const Vec3& x : places) mean = mean + x;
  mean = (1 / static_cast<double>(places.size())) * mean;
  Matrix spread{};
  for (const Vec3& x : places) add_product(spread, x - mean, x - mean);
  const Matrix inverse = inverse_of_symmetric(spread);
  weights.clear();
  for (const Vec3& x : places) weights.push_back(times(inverse, x - mean));
}

}  // namespace deform::quality
