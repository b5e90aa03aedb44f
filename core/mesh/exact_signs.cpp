// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/exact_signs.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

namespace deform {

namespace {

constexpr double half_ulp = std::numeric_limits<double>::epsilon() / 2;

int sign(double x) { return x > 0 ? 1 : x < 0 ? -1 : 0; }

/// A sum of doubles without rounding, kept as terms that do not overlap, smallest first.
class ExactSum {
 public:
  void add(double x) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < count_; ++i) {
      const double term = terms_[i], sum = x + term;
      const double part = sum - x;
      const double rest = (x - (sum - part)) + (term - part);
      x = sum;
      if (rest != 0) terms_[kept++] = rest;
    }
    if (x != 0 || kept == 0) terms_[kept++] = x;
    count_ = kept;
  }
  /// Adds s x y z, where s is 1 or -1.
  void add_product(double s, double x, double y, double z) {
    const double high = x * y, low = std::fma(x, y, -high);
    for (const double part : {high, low}) {
      const double product = part * z;
      add(s * std::fma(part, z, -product));
      add(s * product);
    }
  }
  void add_product(double s, double x, double y) {
    const double product = x * y;
    add(s * std::fma(x, y, -product));
    add(s * product);
  }
  int sign() const { return deform::sign(terms_[count_ - 1]); }

 private:
  std::array<double, 128> terms_{};  // at most one per number added: 24 products of three are 96
  std::size_t count_ = 1;
};

/// A determinant with a bound of its rounding.
struct Rounded {
  double value = 0, bound = 0;

  int clear_sign() const { return value > bound ? 1 : value < -bound ? -1 : 0; }
  /// A bound of 0 says that all products have a factor 0, as in planes and on lines along axes.
  bool tells() const { return bound == 0 || clear_sign() != 0; }
};

Rounded plane_determinant(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  const double ax = a[0] - d[0], ay = a[1] - d[1], az = a[2] - d[2];
  const double bx = b[0] - d[0], by = b[1] - d[1], bz = b[2] - d[2];
  const double cx = c[0] - d[0], cy = c[1] - d[1], cz = c[2] - d[2];
  const double bxcy = bx * cy, cxby = cx * by, cxay = cx * ay, axcy = ax * cy, axby = ax * by, bxay = bx * ay;
  const double value = az * (bxcy - cxby) + bz * (cxay - axcy) + cz * (axby - bxay);
  const double size = (std::abs(bxcy) + std::abs(cxby)) * std::abs(az) + (std::abs(cxay) + std::abs(axcy)) * std::abs(bz) +
                      (std::abs(axby) + std::abs(bxay)) * std::abs(cz);
  return {value, (7 + 56 * half_ulp) * half_ulp * size};
}

Rounded line_determinant(const Vec3& a, const Vec3& b, const Vec3& c, int axis) {
  const int x = (axis + 1) % 3, y = (axis + 2) % 3;
  const double left = (a[x] - c[x]) * (b[y] - c[y]), right = (a[y] - c[y]) * (b[x] - c[x]);
  return {left - right, (3 + 16 * half_ulp) * half_ulp * (std::abs(left) + std::abs(right))};
}

}  // namespace

int clear_side_of_plane(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  return plane_determinant(a, b, c, d).clear_sign();
}

int side_of_plane(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  const Rounded rounded = plane_determinant(a, b, c, d);
  if (rounded.tells()) return rounded.clear_sign();
  // | a 1 |
  // | b 1 |   by the cofactors of the last column: det(a, b, c) - det(a, b, d) + det(a, c, d) - det(b, c, d)
  // | c 1 |
  // | d 1 |
  ExactSum sum;
  const auto add = [&](double s, const Vec3& p, const Vec3& q, const Vec3& r) {
    for (int k = 0; k < 3; ++k) {
      sum.add_product(s, p[k], q[(k + 1) % 3], r[(k + 2) % 3]);
      sum.add_product(-s, p[k], q[(k + 2) % 3], r[(k + 1) % 3]);
    }
  };
  add(1, a, b, c);
  add(-1, a, b, d);
  add(1, a, c, d);
  add(-1, b, c, d);
  return sum.sign();
}

int clear_side_of_line(const Vec3& a, const Vec3& b, const Vec3& c, int axis) {
  return line_determinant(a, b, c, axis).clear_sign();
}

int side_of_line(const Vec3& a, const Vec3& b, const Vec3& c, int axis) {
  const Rounded rounded = line_determinant(a, b, c, axis);
  if (rounded.tells()) return rounded.clear_sign();
  const int x = (axis + 1) % 3, y = (axis + 2) % 3;
  ExactSum sum;
  const auto add = [&](double s, const Vec3& p, const Vec3& q) {
    sum.add_product(s, p[x], q[y]);
    sum.add_product(-s, p[y], q[x]);
  };
  add(1, a, b);
  add(1, b, c);
  add(1, c, a);
  return sum.sign();
}

}  // namespace deform
