// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/polygon_fan.h"

#include <algorithm>
#include <limits>

#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr std::size_t most_fan_corners = 64;  // faces with more corners use their first fan

/// Twice the area of a triangle in the direction of `up` over its longest side squared.
double height(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& up) {
  const Vec3 u = b - a, v = c - a, w = v - u;
  const double longest = std::max({dot(u, u), dot(v, v), dot(w, w)});
  return longest > 0 ? dot(cross(u, v), up) / longest : 0;
}

}  // namespace

std::size_t fan_apex(std::span<const Vec3> points, std::span<const PointId> corners) {
  const std::size_t m = corners.size();
  if (m < 4 || m > most_fan_corners) return 0;
  Vec3 up{};
  for (std::size_t i = 2; i < m; ++i) {
    const Vec3 &a = points[corners[0]], &b = points[corners[i - 1]], &c = points[corners[i]];
    up = up + cross(b - a, c - a);
  }
  const double length = norm(up);
  if (!(length > 0)) return 0;
  up = up / length;
  std::size_t apex = 0;
  double best = -std::numeric_limits<double>::infinity();
  for (std::size_t start = 0; start < m; ++start) {
    double lowest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 2; i < m; ++i) {
      const Vec3& b = points[corners[(start + i - 1) % m]];
      const Vec3& c = points[corners[(start + i) % m]];
      lowest = std::min(lowest, height(points[corners[start]], b, c, up));
    }
    if (lowest > best + 1e-9) {  // more than rounding
      best = lowest;
      apex = start;
    }
  }
  return apex;
}

}  // namespace deform
