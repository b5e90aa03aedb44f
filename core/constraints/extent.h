// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// Projects the points into a slab of thickness `value` perpendicular to `axis` (unit length). The position of the slab
/// is fitted.
std::unique_ptr<const Projection> largest_extent_projection(const Vec3& axis, double value, std::size_t points);

/// The points at the two ends of a set, as indices: disjoint lists, neither empty.
struct ExtentEnds {
  std::vector<std::size_t> lower, upper;
};
/// Projects the upper points above and the lower ones below two planes perpendicular to `axis` (unit length) at distance `value`,
/// whose position is fitted; the others are free.
std::unique_ptr<const Projection> least_extent_projection(const Vec3& axis, double value, const ExtentEnds& ends,
                                                          std::size_t points);

/// The points whose distance from an end of the set along `axis` is at most `share` of its extent.
ExtentEnds extent_ends(std::span<const Vec3> x, const Vec3& axis, double share);

}  // namespace deform
