// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/motion/variable_motion.h"

#include <array>
#include <cmath>
#include <numbers>

#include "core/base/vectors.h"

namespace deform {

namespace {

bool is_zero(const Vec3& v) { return v[0] == 0 && v[1] == 0 && v[2] == 0; }
Vec3 normalized(const Vec3& v) { return v / norm(v); }

// The affine map of one variable at value v and its derivative with respect to v.
Affine translation(const Vec3& d, double v) { return {1, 0, 0, v * d[0], 0, 1, 0, v * d[1], 0, 0, 1, v * d[2]}; }

// A and b = c - A c for the linear map A about the centre c.
Affine about(const std::array<double, 9>& A, const Vec3& c, double keep) {
  Affine m{};
  for (int i = 0; i < 3; ++i) {
    double moved = 0;
    for (int j = 0; j < 3; ++j) {
      m[4 * i + j] = A[3 * i + j];
      moved += A[3 * i + j] * c[j];
    }
    m[4 * i + 3] = keep * c[i] - moved;
  }
  return m;
}

// Rodrigues: cos I + sin [a]x + (1 - cos) a a^T, with the factors given, so that the derivative is the same expression.
std::array<double, 9> rodrigues(const Vec3& a, double identity, double cross, double outer) {
  return {identity + outer * a[0] * a[0],     outer * a[0] * a[1] - cross * a[2], outer * a[0] * a[2] + cross * a[1],
          outer * a[1] * a[0] + cross * a[2], identity + outer * a[1] * a[1],     outer * a[1] * a[2] - cross * a[0],
          outer * a[2] * a[0] - cross * a[1], outer * a[2] * a[1] + cross * a[0], identity + outer * a[2] * a[2]};
}

/// Radians in one unit of the variable.
double unit_of(const Rotation& rotation) { return rotation.unit == AngleUnit::degrees ? std::numbers::pi / 180 : 1; }

std::array<double, 9> scaling(const Vec3& axis, double identity, double v) {
  if (is_zero(axis)) return {identity + v, 0, 0, 0, identity + v, 0, 0, 0, identity + v};
  return rodrigues(normalized(axis), identity, 0, v);
}

}  // namespace

Affine motion_at(const VariableMotion& motion, double v) {
  if (v == 0) return identity_affine;  // exactly at rest, whatever the centre
  if (const auto* t = std::get_if<Translation>(&motion)) return translation(t->direction, v);
  if (const auto* r = std::get_if<Rotation>(&motion)) {
    const double angle = v * unit_of(*r);
    return about(rodrigues(normalized(r->axis), std::cos(angle), std::sin(angle), 1 - std::cos(angle)), r->centre, 1);
  }
  const auto& s = std::get<Scaling>(motion);
  return about(scaling(s.axis, 1, v), s.centre, 1);
}

Affine motion_rate(const VariableMotion& motion, double v) {
  if (const auto* t = std::get_if<Translation>(&motion)) {
    return {0, 0, 0, t->direction[0], 0, 0, 0, t->direction[1], 0, 0, 0, t->direction[2]};
  }
  if (const auto* r = std::get_if<Rotation>(&motion)) {
    const double unit = unit_of(*r), rate = unit * std::sin(v * unit);
    return about(rodrigues(normalized(r->axis), -rate, unit * std::cos(v * unit), rate), r->centre, 0);
  }
  const auto& s = std::get<Scaling>(motion);
  return about(scaling(s.axis, 0, 1), s.centre, 0);
}

}  // namespace deform
