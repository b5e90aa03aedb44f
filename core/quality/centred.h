// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/base/types.h"
#include "core/base/vectors.h"

namespace deform::quality {

inline constexpr double unbounded = std::numeric_limits<double>::infinity();

/// A closed interval, with bounds up to rounding. Unbounded intervals remain unbounded, even when multiplied by 0.
struct Interval {
  double low = 0, high = 0;
  double magnitude() const { return std::max(std::abs(low), std::abs(high)); }
};

inline Interval operator+(const Interval& a, const Interval& b) { return {a.low + b.low, a.high + b.high}; }
inline Interval operator-(const Interval& a, const Interval& b) { return {a.low - b.high, a.high - b.low}; }
inline Interval operator*(const Interval& a, const Interval& b) {
  const double p[] = {a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high};
  const Interval product{std::min(std::min(p[0], p[1]), std::min(p[2], p[3])),
                         std::max(std::max(p[0], p[1]), std::max(p[2], p[3]))};
  if (std::isnan(p[0] + p[1] + p[2] + p[3])) return {-unbounded, unbounded};
  return product;
}

/// The centred form of a function of u in [-1, 1]: its value at the midpoint, and bounds of the function and its derivative. By
/// the mean value theorem the function is within value +- |derivative|, so halving the interval reduces the excess of the bounds
/// by a factor of four. Moore, Kearfott, Cloud, Introduction to Interval Analysis (2009), chapter 6.
struct Centred {
  double value = 0;
  Interval range, derivative;

  Centred() = default;
  Centred(double v) : value(v), range{v, v} {}  // NOLINT: implicit from a number
  Centred(double v, const Interval& r, const Interval& d) : value(v), range(r), derivative(d) {
    const double reach = d.magnitude();
    range.low = std::max(range.low, v - reach);
    range.high = std::min(range.high, v + reach);
  }
  /// start + s slope for s = middle + radius u
  static Centred linear(double start, double slope, double middle, double radius) {
    const double v = start + middle * slope, d = radius * slope;
    return {v, {v - std::abs(d), v + std::abs(d)}, {d, d}};
  }
};

inline Centred operator+(const Centred& a, const Centred& b) {
  return {a.value + b.value, a.range + b.range, a.derivative + b.derivative};
}
inline Centred operator-(const Centred& a, const Centred& b) {
  return {a.value - b.value, a.range - b.range, a.derivative - b.derivative};
}
inline Centred operator*(const Centred& a, const Centred& b) {
  return {a.value * b.value, a.range * b.range, a.derivative * b.range + a.range * b.derivative};
}
inline Centred operator*(double a, const Centred& b) {
  const Interval factor{a, a};
  return {a * b.value, factor * b.range, factor * b.derivative};
}

inline Centred inverse(const Centred& a) {
  if (!(a.range.low > 0)) return {1 / a.value, {-unbounded, unbounded}, {-unbounded, unbounded}};
  const Interval range{1 / a.range.high, 1 / a.range.low};
  return {1 / a.value, range, Interval{-1, -1} * a.derivative * range * range};
}
inline double inverse(double a) { return 1 / a; }

/// Uses that the length of a vector does not change faster than the vector.
inline Centred length(const std::array<Centred, 3>& a) {
  double least = 0, largest = 0, speed = 0;
  Interval product;
  for (const Centred& x : a) {
    const double nearest = x.range.low > 0 ? x.range.low : x.range.high < 0 ? x.range.high : 0;
    least += nearest * nearest;
    largest += x.range.magnitude() * x.range.magnitude();
    speed += x.derivative.magnitude() * x.derivative.magnitude();
    product = product + x.range * x.derivative;
  }
  const Interval range{std::sqrt(least), std::sqrt(largest)};
  speed = std::sqrt(speed);
  Interval derivative{-speed, speed};
  if (range.low > 0) {
    const Interval along = product * Interval{1 / range.high, 1 / range.low};
    derivative = {std::max(derivative.low, along.low), std::min(derivative.high, along.high)};
  }
  return {std::sqrt(a[0].value * a[0].value + a[1].value * a[1].value + a[2].value * a[2].value), range, derivative};
}

/// Bounds of a function, or of a plain number.
inline double lower_bound(const Centred& a) { return a.range.low; }
inline double upper_bound(const Centred& a) { return a.range.high; }
inline double lower_bound(double a) { return a; }
inline double upper_bound(double a) { return a; }

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
template <typename T>
Triple<T> cross(const Triple<T>& a, const Triple<T>& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

}  // namespace deform::quality
