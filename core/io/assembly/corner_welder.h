// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "core/base/types.h"

namespace deform::io {

/// Merges points with equal coordinates and numbers them in order of first appearance (zero and minus zero are equal).
class CornerWelder {
 public:
  /// The number of the point at this place; adds a point if there is none.
  PointId weld(const Vec3& place);
  std::size_t point_count() const { return points_.size(); }
  Points take_points() { return std::move(points_); }

 private:
  std::size_t slot_of(const Vec3& place) const;
  void grow();

  static constexpr PointId empty_slot = ~PointId{0};
  Points points_;
  std::vector<PointId> slots_;  // open addressing, a power of two, at most half full
};

}  // namespace deform::io
