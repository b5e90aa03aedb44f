// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// The sides of planes on which points are to stay, as those of a half model on its side of a symmetry plane: beyond it the whole
/// model runs through itself. Immutable; any thread.
class PlaneSides {
 public:
  /// A plane and the side of it.
  struct Side {
    Vec3 normal{};      ///< unit, to the side of the points
    double offset = 0;  ///< the coordinate of x is normal . x + offset, model units
    double limit = 0;   ///< coordinates below -limit are on the other side
  };
  /// What was found in some points of a design.
  struct Crossings {
    std::size_t points = 0;    ///< how many
    double distance = 0;       ///< of the farthest beyond its plane, model units
    std::size_t farthest = 0;  ///< its id, the first of several

    /// Adds what was found in later points.
    void add(const Crossings& later);
    /// "1873 of 8241 points crossed a symmetry plane, point 17 farthest, by 0.046", of so many points. There must be one.
    std::string text(std::size_t of) const;
  };

  PlaneSides() = default;  ///< no planes
  /// On these sides of them.
  explicit PlaneSides(std::vector<Side> sides) : sides_(std::move(sides)) {}

  bool empty() const { return sides_.empty(); }  ///< whether there are no planes
  /// points: deformed points first, first + 1, ... of the mesh. rounding: how far their coordinates may be off, model units.
  Crossings crossings(std::span<const Vec3> points, std::size_t first, double rounding = 0) const;

 private:
  std::vector<Side> sides_;
};

}  // namespace deform
