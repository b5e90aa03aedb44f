// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Points one after the other, and how far the others are from those taken. For one thread.
class PointCover {
 public:
  explicit PointCover(std::span<const Vec3> points);

  /// Makes a point the next one.
  void take(std::size_t point);
  const std::vector<std::uint32_t>& taken() const { return taken_; }
  /// To the nearest point taken; 0 for those taken and all that coincide with one, infinite before any.
  double distance(std::size_t point) const;
  /// The point of largest distance to those taken, of equal ones the first; before any the one farthest from the mean of all.
  std::size_t farthest() const;

 private:
  std::span<const Vec3> points_;
  std::vector<double> squares_;  ///< of the distances
  std::vector<std::uint32_t> taken_;
};

/// The farthest-point order (Gonzalez 1985; thesis 7.5) of `count` of the points: each has the largest distance to those before.
/// Fewer when only points are left that coincide with earlier ones. Deterministic; takes size x count steps.
std::vector<std::uint32_t> farthest_point_order(std::span<const Vec3> points, std::size_t count);

}  // namespace deform
