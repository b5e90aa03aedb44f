// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>

#include "core/base/types.h"
#include "core/base/vectors.h"

namespace deform::quality {

/// The coefficients of a polynomial on an interval in the Bernstein basis. The polynomial lies between the smallest and the
/// largest coefficient; halving the interval reduces the gap by a factor of four.
template <std::size_t N>
using Bernstein = std::array<double, N>;

/// The first s in [low, high], the interval of p, with p(s) <= 0; infinity if there is none or it is beyond `bound`. Found by
/// bisection (de Casteljau) to the last bit and never too late, because the part before it has positive coefficients; so roots of
/// any multiplicity are treated alike. NaN counts as not positive.
template <std::size_t N>
double first_not_positive(const Bernstein<N>& p, double low, double high, double bound) {
  if (low > bound || std::all_of(p.begin(), p.end(), [](double c) { return c > 0; })) {
    return std::numeric_limits<double>::infinity();
  }
  const double middle = 0.5 * (low + high);
  if (!(p[0] > 0) || middle <= low || middle >= high) return low;
  Bernstein<N> left, right = p;
  for (std::size_t k = 0; k < N; ++k) {
    left[k] = right[0];
    for (std::size_t i = 0; i + 1 < N - k; ++i) right[i] = 0.5 * (right[i] + right[i + 1]);
  }
  const double first = first_not_positive(left, low, middle, bound);
  return first <= middle ? first : first_not_positive(right, middle, high, bound);
}

/// det(a(s), b(s), c(s)) - share |a|(s) |b|(s) |c|(s) on [0, 1], where a, b, c and the lengths |a|, |b|, |c| are interpolated
/// linearly between `from` and `to`. At the ends this compares the normalized determinant with `share`; in between the product of
/// the interpolated lengths is an upper bound of the product of the lengths.
inline Bernstein<4> determinant(const std::array<Vec3, 3>& from, const std::array<Vec3, 3>& to, double share) {
  const Vec3 fa = cross(from[1], from[2]), ta = cross(to[1], to[2]);
  const Vec3 mixed = cross(from[1], to[2]) + cross(to[1], from[2]);
  std::array<double, 3> f, t;
  for (std::size_t k = 0; k < 3; ++k) {
    f[k] = length(from[k]);
    t[k] = length(to[k]);
  }
  const auto coefficient = [&](double value, double size) { return value - share * size; };
  return {coefficient(dot(from[0], fa), f[0] * f[1] * f[2]),
          coefficient((dot(to[0], fa) + dot(from[0], mixed)) / 3, (t[0] * f[1] * f[2] + f[0] * (f[1] * t[2] + t[1] * f[2])) / 3),
          coefficient((dot(from[0], ta) + dot(to[0], mixed)) / 3, (f[0] * t[1] * t[2] + t[0] * (f[1] * t[2] + t[1] * f[2])) / 3),
          coefficient(dot(to[0], ta), t[0] * t[1] * t[2])};
}

/// The same in the plane, for x and y.
inline Bernstein<3> determinant(const std::array<Vec3, 2>& from, const std::array<Vec3, 2>& to, double share) {
  const auto area = [](const Vec3& a, const Vec3& b) { return a[0] * b[1] - a[1] * b[0]; };
  const double fa = length(from[0]), fb = length(from[1]), ta = length(to[0]), tb = length(to[1]);
  return {area(from[0], from[1]) - share * fa * fb,
          (area(from[0], to[1]) + area(to[0], from[1])) / 2 - share * (fa * tb + ta * fb) / 2,
          area(to[0], to[1]) - share * ta * tb};
}

}  // namespace deform::quality
