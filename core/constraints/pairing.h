// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// For each point of `from` the nearest point of `to`, which must not be empty; the first one of several. O((n + m) log m) for
/// points on a surface or in a volume.
std::vector<std::uint32_t> nearest_points(std::span<const Vec3> from, std::span<const Vec3> to);

/// The pairs (index in a, index in b) of points that are nearest to each other, ascending.
std::vector<std::pair<std::uint32_t, std::uint32_t>> mutual_pairs(std::span<const Vec3> a, std::span<const Vec3> b);

/// A pairing of mirror images. The points are those of all regions, in order.
struct MirrorPairs {
  std::vector<std::uint32_t> partner;  ///< partner[partner[i]] == i; partner[i] == i for points in the plane
  std::size_t unmatched = 0;           ///< number of points without a partner; if not 0, `partner` is invalid
  std::size_t first_unmatched = 0;
};

struct MirrorPlane {
  Vec3 point{}, normal{};  ///< unit length
};

/// Pairs points with their mirror images, within a distance `tolerance`. The first `first` points of `x` belong to the first
/// region; the others, if any, belong to the second, and then partners are in different regions.
MirrorPairs mirror_pairs(std::span<const Vec3> x, std::size_t first, const MirrorPlane& plane, double tolerance);

/// The symmetry plane of two regions (first < x.size()), halfway between their means, or of a single region: perpendicular to the
/// longest of its principal axes for which all points have partners, if there is one.
std::optional<MirrorPlane> find_mirror_plane(std::span<const Vec3> x, std::size_t first, double tolerance);

}  // namespace deform
