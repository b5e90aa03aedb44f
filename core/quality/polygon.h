// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/base/vectors.h"

namespace deform::quality {

/// Mean of the corners; the origin without any.
inline Vec3 mean_of(std::span<const Vec3> points, std::span<const PointId> corners) {
  Vec3 sum{};
  for (const PointId p : corners) sum = sum + points[p];
  return corners.empty() ? sum : (1 / static_cast<double>(corners.size())) * sum;
}

/// Area times unit normal. The same for every way to cut the polygon into triangles, flat or not.
inline Vec3 vector_area(std::span<const Vec3> points, std::span<const PointId> corners) {
  Vec3 twice{};
  for (std::size_t c = 1; c + 1 < corners.size(); ++c) {
    twice = twice + cross(points[corners[c]] - points[corners[0]], points[corners[c + 1]] - points[corners[0]]);
  }
  return 0.5 * twice;
}

/// Radians, 0..pi; also of nearly parallel vectors to full precision. 0 when one of them is zero.
inline double angle_between(const Vec3& a, const Vec3& b) { return std::atan2(length(cross(a, b)), dot(a, b)); }

}  // namespace deform::quality
