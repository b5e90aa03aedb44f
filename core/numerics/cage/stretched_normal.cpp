// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/cage/stretched_normal.h"

#include <algorithm>
#include <cmath>

#include "core/base/vectors.h"

namespace deform {

namespace {

/// Height over the length of a triangle below which it has no normal: rounding turns the normal by up to 1e-4 there.
constexpr double least_height = 1e-12;

}  // namespace

struct StretchedNormal::Moved {
  Vec3 u, v;
  Vec3 normal;
  double twice = 0;    ///< twice the area
  double stretch = 0;  ///< s
};

StretchedNormal::StretchedNormal(const Corners& rest) {
  const Vec3 u = rest[1] - rest[0], v = rest[2] - rest[0], across = cross(u, v);
  const double twice = norm(across);
  u2_ = dot(u, u);
  uv_ = dot(u, v);
  v2_ = dot(v, v);
  doubled_ = 2 * twice * twice;
  const Moved m = moved_sides(rest);
  normal_ = m.stretch * m.normal;  // so that nothing changes at rest, not even by rounding
}

StretchedNormal::Moved StretchedNormal::moved_sides(const Corners& moved) const {
  Moved m{moved[1] - moved[0], moved[2] - moved[0], {}, 0, 0};
  const Vec3 across = cross(m.u, m.v);
  m.twice = norm(across);
  m.normal = across / m.twice;
  m.stretch = std::sqrt((dot(m.u, m.u) * v2_ - 2 * dot(m.u, m.v) * uv_ + dot(m.v, m.v) * u2_) / doubled_);
  return m;
}

bool StretchedNormal::exists(const Corners& moved) const {
  const Vec3 u = moved[1] - moved[0], v = moved[2] - moved[0];
  const double longest = std::max({dot(u, u), dot(v, v), squared_distance(moved[1], moved[2])});
  return norm(cross(u, v)) > least_height * longest;
}

Vec3 StretchedNormal::change(const Corners& moved) const {
  const Moved m = moved_sides(moved);
  return m.stretch * m.normal - normal_;
}

Vec3 StretchedNormal::rate(const Corners& moved, const Corners& rates) const {
  const Moved m = moved_sides(moved);
  const Vec3 du = rates[1] - rates[0], dv = rates[2] - rates[0];
  const double stretched =
      (v2_ * dot(m.u, du) - uv_ * (dot(du, m.v) + dot(m.u, dv)) + u2_ * dot(m.v, dv)) / (doubled_ * m.stretch);
  const Vec3 turned = cross(du, m.v) + cross(m.u, dv);
  return stretched * m.normal + (m.stretch / m.twice) * (turned - dot(m.normal, turned) * m.normal);
}

StretchedNormal::Corners StretchedNormal::gradient(const Corners& moved, const Vec3& cotangent) const {
  const Moved m = moved_sides(moved);
  const double along = dot(m.normal, cotangent), stretched = along / (doubled_ * m.stretch);
  const Vec3 turned = (m.stretch / m.twice) * (cotangent - along * m.normal);
  const Vec3 of_u = stretched * (v2_ * m.u - uv_ * m.v) + cross(m.v, turned);
  const Vec3 of_v = stretched * (u2_ * m.v - uv_ * m.u) + cross(turned, m.u);
  return {-1.0 * (of_u + of_v), of_u, of_v};
}

}  // namespace deform
