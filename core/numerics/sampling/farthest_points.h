// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Selects points one by one and keeps the distances of all points to the selected ones. Not thread-safe.
class PointCover {
 public:
  explicit PointCover(std::span<const Vec3> points);

  /// Selects a point.
  void take(std::size_t point);
  const std::vector<std::uint32_t>& taken() const { return taken_; }
  /// Distance to the nearest selected point: 0 for selected points and those that coincide with one, infinite before the
  /// first selection.
  double distance(std::size_t point) const;
  /// The point with the largest distance to the selected ones, the first of several whose squared distances are equal up to
  /// this fraction; before the first selection, the point farthest from the mean of all.
  std::size_t farthest(double alike = 0) const;

 private:
  std::span<const Vec3> points_;
  std::vector<double> squares_;  ///< squared distances
  std::vector<std::uint32_t> taken_;
};

/// The first `count` points of a farthest-point order (Gonzalez 1985; thesis 7.5): each has the largest distance to the preceding
/// ones. Returns fewer if all remaining points coincide with earlier ones, or are not farther from them than `least`.
/// Deterministic; O(size x count). On regular meshes many points are equally far: with `alike`, see PointCover::farthest(),
/// rounding does not decide between them, so that the order is the same in other units.
std::vector<std::uint32_t> farthest_point_order(std::span<const Vec3> points, std::size_t count, double alike = 0,
                                                double least = 0);

}  // namespace deform
