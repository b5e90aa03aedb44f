// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "core/base/types.h"
#include "core/base/vectors.h"

namespace deform::quality {

inline constexpr double unbounded = std::numeric_limits<double>::infinity();

/// A function of u in [-1, 1] as a polynomial of degree 3 and a bound of what that leaves out, up to rounding. Halving the
/// interval reduces what is left out by a factor of sixteen. Makino, Berz, Taylor models and other validated functional inclusion
/// methods, International Journal of Pure and Applied Mathematics 4 (2003).
struct TaylorModel {
  std::array<double, 4> c{};  ///< of the powers of u
  double rest = 0;            ///< |f - polynomial| at most

  TaylorModel() = default;
  TaylorModel(double value) : c{value, 0, 0, 0} {}  // NOLINT: implicit from a number
  TaylorModel(double constant, double linear, double square, double cube = 0, double left_out = 0)
      : c{constant, linear, square, cube}, rest(left_out) {}

  /// At least |f|.
  double magnitude() const { return std::abs(c[0]) + std::abs(c[1]) + std::abs(c[2]) + std::abs(c[3]) + rest; }
};

inline TaylorModel operator+(const TaylorModel& a, const TaylorModel& b) {
  return {a.c[0] + b.c[0], a.c[1] + b.c[1], a.c[2] + b.c[2], a.c[3] + b.c[3], a.rest + b.rest};
}
inline TaylorModel operator-(const TaylorModel& a, const TaylorModel& b) {
  return {a.c[0] - b.c[0], a.c[1] - b.c[1], a.c[2] - b.c[2], a.c[3] - b.c[3], a.rest + b.rest};
}
inline TaylorModel operator*(double a, const TaylorModel& b) {
  return {a * b.c[0], a * b.c[1], a * b.c[2], a * b.c[3], std::abs(a) * b.rest};
}
/// What the powers 4 and 6 of u amount to is between 0 and their coefficient: half of it goes into the constant.
inline TaylorModel operator*(const TaylorModel& a, const TaylorModel& b) {
  const double fourth = a.c[1] * b.c[3] + a.c[2] * b.c[2] + a.c[3] * b.c[1], fifth = a.c[2] * b.c[3] + a.c[3] * b.c[2],
               sixth = a.c[3] * b.c[3];
  const double left_out = 0.5 * std::abs(fourth) + std::abs(fifth) + 0.5 * std::abs(sixth) + a.rest * b.magnitude() +
                          b.rest * (a.magnitude() - a.rest);
  return {a.c[0] * b.c[0] + 0.5 * (fourth + sixth), a.c[0] * b.c[1] + a.c[1] * b.c[0],
          a.c[0] * b.c[2] + a.c[1] * b.c[1] + a.c[2] * b.c[0],
          a.c[0] * b.c[3] + a.c[1] * b.c[2] + a.c[2] * b.c[1] + a.c[3] * b.c[0], left_out};
}

/// f times a linear function.
inline TaylorModel times_linear(const TaylorModel& f, double constant, double linear) {
  const double fourth = 0.5 * f.c[3] * linear;
  return {f.c[0] * constant + fourth, f.c[1] * constant + f.c[0] * linear, f.c[2] * constant + f.c[1] * linear,
          f.c[3] * constant + f.c[2] * linear, std::abs(fourth) + f.rest * (std::abs(constant) + std::abs(linear))};
}

/// The squared length of a quadratic vector.
inline TaylorModel squared_length(const Vec3& constant, const Vec3& linear, const Vec3& square) {
  const double fourth = 0.5 * dot(square, square);
  return {dot(constant, constant) + fourth, 2 * dot(constant, linear), 2 * dot(constant, square) + dot(linear, linear),
          2 * dot(linear, square), fourth};
}

/// Bounds of a function, or of a plain number. u^3 is 3/4 u but for 1/4; of the quadratic polynomial that remains it is the
/// minimum.
inline double lower_bound(const TaylorModel& a) {
  const double linear = std::abs(a.c[1] + 0.75 * a.c[3]), square = a.c[2];
  const double least = 2 * square > linear ? -0.25 * linear * linear / square : square - linear;
  return a.c[0] + least - 0.25 * std::abs(a.c[3]) - a.rest;
}
inline double upper_bound(const TaylorModel& a) { return -lower_bound(-1.0 * a); }
inline double lower_bound(double a) { return a; }
inline double upper_bound(double a) { return a; }

/// f as middle (1 + x) with |x| <= reach < 1; not if f may not be positive.
struct AroundMiddle {
  bool positive = false;
  double middle = 0, reach = 0;
  TaylorModel x;

  explicit AroundMiddle(const TaylorModel& f) {
    const double low = lower_bound(f), high = upper_bound(f);
    positive = low > 0 && high < unbounded;
    if (!positive) return;
    middle = 0.5 * (low + high);
    reach = (high - low) / (high + low);
    x = (1 / middle) * f;
    x.c[0] -= 1;
  }
};

inline TaylorModel inverse(const TaylorModel& f) {
  const AroundMiddle around(f);
  if (!around.positive) return {1 / f.c[0], 0, 0, 0, unbounded};
  // 1 - x + x^2 - x^3, and between 0 and x^4 / (1 - |x|).
  const double square = around.reach * around.reach, half = 0.5 * square * square / (1 - around.reach);
  TaylorModel series = TaylorModel(1.0) - around.x * (TaylorModel(1.0) - around.x * (TaylorModel(1.0) - around.x));
  series.c[0] += half;
  series.rest += half;
  return (1 / around.middle) * series;
}
inline double inverse(double a) { return 1 / a; }

/// The square root of a function that is not negative.
inline TaylorModel square_root(const TaylorModel& f) {
  const AroundMiddle around(f);
  if (!around.positive) {
    const double high = upper_bound(f);
    if (!(high < unbounded)) return {f.c[0], 0, 0, 0, unbounded};
    const double half = 0.5 * std::sqrt(std::max(0.0, high));
    return {half, 0, 0, 0, half};
  }
  // 1 + x/2 - x^2/8 + x^3/16, and between 0 and minus the sum of the other coefficients, which all of them are less than at 1.
  constexpr double left_at_one = 0.3125;
  const double square = around.reach * around.reach, half = 0.5 * left_at_one * square * square;
  TaylorModel series = TaylorModel(1.0) + around.x * (TaylorModel(0.5) - around.x * (TaylorModel(0.125) - 0.0625 * around.x));
  series.c[0] -= half;
  series.rest += half;
  return std::sqrt(around.middle) * series;
}

// The operators of vectors, which those below would hide.
using deform::operator+;
using deform::operator-;
using deform::operator*;
using deform::cross;
using deform::dot;
using deform::length;

template <typename T>
using Triple = std::array<T, 3>;

template <typename T>
Triple<T> operator+(const Triple<T>& a, const Triple<T>& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
template <typename T>
Triple<T> operator-(const Triple<T>& a, const Triple<T>& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
template <typename S, typename T>
Triple<T> operator*(const S& s, const Triple<T>& a) {
  return {s * a[0], s * a[1], s * a[2]};
}
template <typename T>
T dot(const Triple<T>& a, const Triple<T>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// Not less than the length anywhere.
inline double longest(const Triple<double>& a) { return length(a); }
inline double longest(const Triple<TaylorModel>& a) {
  double squares = 0;
  for (const TaylorModel& x : a) squares += x.magnitude() * x.magnitude();
  return std::sqrt(squares);
}

}  // namespace deform::quality
