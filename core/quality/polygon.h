// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/base/vectors.h"

namespace deform::quality {

/// The mean of the corners, or the origin if there are none.
inline Vec3 mean_of(std::span<const Vec3> points, std::span<const PointId> corners) {
  Vec3 sum{};
  for (const PointId p : corners) sum = sum + points[p];
  return corners.empty() ? sum : (1 / static_cast<double>(corners.size())) * sum;
}

/// Area times unit normal. Does not depend on the triangulation, even if the polygon is not planar.
inline Vec3 vector_area(std::span<const Vec3> points, std::span<const PointId> corners) {
  Vec3 twice{};
  for (std::size_t c = 1; c + 1 < corners.size(); ++c) {
    twice = twice + cross(points[corners[c]] - points[corners[0]], points[corners[c + 1]] - points[corners[0]]);
  }
  return 0.5 * twice;
}

/// The angle in radians, 0..pi, accurate also for nearly parallel vectors. 0 if one of them is zero.
inline double angle_between(const Vec3& a, const Vec3& b) { return std::atan2(length(cross(a, b)), dot(a, b)); }

}  // namespace deform::quality
