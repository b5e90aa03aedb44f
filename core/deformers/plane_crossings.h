// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"
#include "core/quality/extreme.h"

namespace deform {

/// Finds the points of a half model that a design moves across a symmetry plane, where the whole model runs through itself.
/// Points on a plane slide in it; nothing keeps others on their side. Immutable; any thread.
class PlaneCrossings {
 public:
  /// What was found in some points of a design.
  struct Found {
    std::size_t points = 0;
    Extreme farthest;  ///< beyond the plane, model units, and the id of the point, the first of several

    /// Adds what was found in later points.
    void add(const Found& later);
  };

  PlaneCrossings() = default;  ///< no planes
  /// None for setups without symmetry planes and for sectors. Throws as Symmetry.
  PlaneCrossings(const Setup& setup, const Mesh& mesh);

  bool empty() const { return sides_.empty(); }
  /// points: deformed points first, first + 1, ... of the mesh.
  Found in(std::span<const Vec3> points, std::size_t first) const;

 private:
  struct Side {
    Vec3 normal{};      ///< unit, to the side of the mesh
    double offset = 0;  ///< the coordinate of x is normal . x + offset
    double limit = 0;   ///< coordinates below -limit are on the other side
  };
  std::vector<Side> sides_;
};

/// "1873 of 8241 points crossed a symmetry plane, point 17 farthest, by 0.046". There must be one.
std::string crossed_planes_text(const PlaneCrossings::Found& found, std::size_t points);

}  // namespace deform
