// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// For every point of `from` the nearest of `to` (not empty), the first of equally near ones. O((n + m) log m) for points of a
/// surface or volume.
std::vector<std::uint32_t> nearest_points(std::span<const Vec3> from, std::span<const Vec3> to);

/// Pairs (number in a, number in b) of points that are each other's nearest, ascending.
std::vector<std::pair<std::uint32_t, std::uint32_t>> mutual_pairs(std::span<const Vec3> a, std::span<const Vec3> b);

/// Who is whose mirror image. Points of all regions one after the other.
struct MirrorPairs {
  std::vector<std::uint32_t> partner;  ///< partner[partner[i]] == i; of a point in the plane itself
  std::size_t unmatched = 0;           ///< points without one; then `partner` is of no use
  std::size_t first_unmatched = 0;
};

struct MirrorPlane {
  Vec3 point{}, normal{};  ///< unit length
};

/// Pairs in a plane; `first` points of `x` are of the first region, the others (if any) of the second and then partners stand in
/// the other region. Partners are within `tolerance` (a length) of the mirror images.
MirrorPairs mirror_pairs(std::span<const Vec3> x, std::size_t first, const MirrorPlane& plane, double tolerance);

/// The plane that two regions (first < x.size()) are mirror images in: halfway between their means; or that one is symmetric in:
/// across one of its principal axes, the longest for which all points have partners, if there is one.
std::optional<MirrorPlane> find_mirror_plane(std::span<const Vec3> x, std::size_t first, double tolerance);

}  // namespace deform
