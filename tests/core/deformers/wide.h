// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cmath>

#include "core/base/types.h"
#include "core/base/vectors.h"

namespace deform::test {

// Beside those of this file.
using deform::operator+;
using deform::operator-;
using deform::operator*;
using deform::operator/;
using deform::dot;
using deform::length;

/// A number of 106 bits, the sum of two doubles (Dekker 1971; Hida, Li, Bailey 2001). It belongs to the tests alone, so that what
/// judges a result shares no code with what made it.
struct Wide {
  double hi = 0, lo = 0;

  Wide() = default;
  Wide(double x) : hi(x) {}  // NOLINT(google-explicit-constructor): it is a number
  Wide(double high, double low) : hi(high), lo(low) {}
  static Wide of(long double x) {
    const auto high = static_cast<double>(x);
    return {high, static_cast<double>(x - static_cast<long double>(high))};
  }
  long double extended() const { return static_cast<long double>(hi) + static_cast<long double>(lo); }
};

using WideVec = std::array<Wide, 3>;

/// a + b for |a| >= |b|.
inline Wide ordered_sum(double a, double b) {
  const double sum = a + b;
  return {sum, b - (sum - a)};
}
inline Wide exact_sum(double a, double b) {
  const double sum = a + b, part = sum - a;
  return {sum, (a - (sum - part)) + (b - part)};
}
inline Wide exact_product(double a, double b) {
  const double product = a * b;
  return {product, std::fma(a, b, -product)};
}
inline Wide operator-(const Wide& a) { return {-a.hi, -a.lo}; }
inline Wide operator+(const Wide& a, const Wide& b) {
  Wide s = exact_sum(a.hi, b.hi);
  const Wide t = exact_sum(a.lo, b.lo);
  s = ordered_sum(s.hi, s.lo + t.hi);
  return ordered_sum(s.hi, s.lo + t.lo);
}
inline Wide operator-(const Wide& a, const Wide& b) { return a + -b; }
inline Wide operator*(const Wide& a, const Wide& b) {
  const Wide p = exact_product(a.hi, b.hi);
  return ordered_sum(p.hi, p.lo + (a.hi * b.lo + a.lo * b.hi));
}
inline Wide operator/(const Wide& a, const Wide& b) {
  const double first = a.hi / b.hi;
  Wide rest = a - b * Wide(first);
  const double second = rest.hi / b.hi;
  rest = rest - b * Wide(second);
  return ordered_sum(first, second) + Wide(rest.hi / b.hi);
}
inline Wide& operator+=(Wide& a, const Wide& b) { return a = a + b; }
inline Wide& operator-=(Wide& a, const Wide& b) { return a = a - b; }
inline Wide sqrt(const Wide& a) {
  if (!(a.hi > 0)) return {};
  const double near = std::sqrt(a.hi);
  const Wide rest = a - exact_product(near, near);
  return ordered_sum(near, rest.hi / (2 * near));
}
/// 2^-9 of what is left of x without multiples of log 2 goes into Taylor's series, whose value is squared nine times.
inline Wide exp(const Wide& x) {
  const Wide log2(0x1.62e42fefa39efp-1, 0x1.abc9e3b39803fp-56);
  if (x.hi < -700) return {};
  const double multiple = std::floor(x.hi / log2.hi + 0.5);
  const Wide all = x - log2 * Wide(multiple), part{std::ldexp(all.hi, -9), std::ldexp(all.lo, -9)};
  // expm1, so that no digits are lost where it is squared.
  Wide term = part, sum = part;
  for (int n = 2; n <= 9; ++n) {
    term = term * part / Wide(n);
    sum += term;
  }
  for (int n = 0; n < 9; ++n) sum = sum * sum + sum + sum;
  sum += Wide(1);
  return {std::ldexp(sum.hi, static_cast<int>(multiple)), std::ldexp(sum.lo, static_cast<int>(multiple))};
}
inline Wide log(const Wide& x) {
  const Wide near(std::log(x.hi));
  return near + x * exp(-near) - Wide(1);
}

inline WideVec operator-(const WideVec& a, const WideVec& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Wide dot(const WideVec& a, const WideVec& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline WideVec wide(const Vec3& x) { return {Wide(x[0]), Wide(x[1]), Wide(x[2])}; }
inline double length(const WideVec& a) { return std::hypot(a[0].hi, a[1].hi, a[2].hi); }

}  // namespace deform::test
