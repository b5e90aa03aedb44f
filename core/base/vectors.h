// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "core/base/types.h"

namespace deform {

// Operations on 3-vectors. Sums are taken in the order x, y, z, so that results are reproducible bit for bit.

inline Vec3 operator+(const Vec3& a, const Vec3& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
inline Vec3 operator-(const Vec3& a, const Vec3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Vec3 operator*(double s, const Vec3& a) { return {s * a[0], s * a[1], s * a[2]}; }
inline Vec3 operator/(const Vec3& a, double s) { return {a[0] / s, a[1] / s, a[2] / s}; }
/// Linear interpolation: a for t = 0, b up to rounding for t = 1.
inline Vec3 lerp(const Vec3& a, const Vec3& b, double t) {
  return {a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])};
}

inline double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

/// The Euclidean norm. Fast, but the squares must neither overflow nor underflow.
inline double length(const Vec3& a) { return std::sqrt(dot(a, a)); }
/// The Euclidean norm without overflow or underflow of squares, at the cost of std::hypot().
/// NaN where a component is: libstdc++ takes (0, NaN, 0) for 0.
inline double norm(const Vec3& a) {
  const double size = std::hypot(a[0], a[1], a[2]);
  return size > 0 ? size : std::abs(a[0]) + std::abs(a[1]) + std::abs(a[2]);
}
/// norm() of the difference.
inline double distance(const Vec3& a, const Vec3& b) { return norm(a - b); }
inline double squared_distance(const Vec3& a, const Vec3& b) {
  const Vec3 d = a - b;
  return dot(d, d);
}

inline bool is_finite(const Vec3& v) { return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]); }

}  // namespace deform
