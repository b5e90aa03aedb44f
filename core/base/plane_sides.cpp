// SPDX-License-Identifier: Apache-2.0
#include "core/base/plane_sides.h"

#include <cstdio>

#include "core/base/vectors.h"

namespace deform {

void PlaneSides::Crossings::add(const Crossings& later) {
  points += later.points;
  if (later.distance > distance) {
    distance = later.distance;
    farthest = later.farthest;
  }
}

std::string PlaneSides::Crossings::text(std::size_t of) const {
  char beyond[40];
  std::snprintf(beyond, sizeof beyond, "%.3g", distance);
  return std::to_string(points) + " of " + std::to_string(of) + " points crossed a symmetry plane, point " +
         std::to_string(farthest) + " farthest, by " + beyond;
}

PlaneSides::Crossings PlaneSides::crossings(std::span<const Vec3> points, std::size_t first, double rounding) const {
  Crossings found;
  if (sides_.empty()) return found;
  for (std::size_t i = 0; i < points.size(); ++i) {
    double beyond = 0;
    for (const Side& side : sides_) {
      const double coordinate = dot(side.normal, points[i]) + side.offset;
      if (coordinate < -side.limit - rounding && -coordinate > beyond) beyond = -coordinate;
    }
    if (beyond > 0) found.add({1, beyond, first + i});
  }
  return found;
}

}  // namespace deform
