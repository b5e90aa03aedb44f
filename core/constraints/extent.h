// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// All points between two planes across `axis` (unit length) that are `value` apart, wherever they are.
std::unique_ptr<const Projection> largest_extent_projection(const Vec3& axis, double value, std::size_t points);

/// The upper points stay above and the lower ones below two planes across `axis` (unit length) that are `value` apart, wherever
/// they are; the others are free. Disjoint lists of numbers below `points`, neither empty.
struct ExtentEnds {
  std::vector<std::size_t> lower, upper;
};
std::unique_ptr<const Projection> least_extent_projection(const Vec3& axis, double value, const ExtentEnds& ends,
                                                          std::size_t points);

/// The points within `share` of the extent of the set from its ends.
ExtentEnds extent_ends(std::span<const Vec3> x, const Vec3& axis, double share);

}  // namespace deform
