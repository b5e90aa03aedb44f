// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/base/run_context.h"
#include "core/constraints/sections.h"
#include "core/deformers/constrained/constrained_points.h"
#include "core/deformers/constrained/joint_sets.h"

namespace deform {

/// Puts points on the shapes of some sets: the nearest points that are on them. A set that shares no point with another and holds
/// no point that may not move is projected, the others are placed by JointSets.
///
/// No point moves farther than 3 times the largest distance of all sets before and 1e-6, and no distance ends larger than that
/// largest one. Sets for which this cannot be are given up, as few as can be found by leaving out the worst one after the other:
/// first those that the points that may not move contradict, then those that others contradict. What is given up keeps its
/// points, but for those that it shares with sets that are placed. Unit coordinates. Immutable; any thread.
class ExactPlacement {
 public:
  /// moves: per point of the mesh, whether it may. The sets are taken in their order; the same sets in the same order give the
  /// same bits.
  ExactPlacement(std::vector<ConstraintSet> sets, const std::vector<bool>& moves);

  /// U: the points of all sets, ascending.
  const std::vector<PointId>& ids() const { return ids_; }
  bool moves(std::size_t u) const { return moves_[u]; }
  std::size_t bytes() const;
  /// What place() and the derivatives take besides, at most: from the points at rest.
  std::size_t working_bytes(const RunContext& context) const;

  /// Sets that are placed together.
  struct Group {
    std::vector<std::size_t> sets;
    JointSets::State at;  ///< about the points of the group; forces are empty for one set that is projected
    bool projected = false;
    bool sectioned = false;  ///< circles are sections of their cylinders
  };
  struct Placed {
    std::vector<Vec3> from, points;  ///< U
    std::vector<bool> given_up;      ///< per set
    std::vector<Group> groups;       ///< of those that are placed
    double distance = 0;             ///< in `from`, largest over all sets

    /// Whether any set is placed.
    bool any() const { return !groups.empty(); }
    void give_up() {
      points = from;
      groups.clear();
      given_up.assign(given_up.size(), true);
    }
    /// How far a point may move.
    double most_movement() const { return 3 * distance + 1e-6; }
  };
  Placed place(std::vector<Vec3> from, const RunContext& context) const;
  /// How points change with `from` (of those that may not move: with themselves): U from U.
  std::vector<Vec3> derivative(const Placed& at, const std::vector<Vec3>& change, const RunContext& context) const;
  std::vector<Vec3> adjoint(const Placed& at, const std::vector<Vec3>& cotangent, const RunContext& context) const;

 private:
  enum class Circles { apart, sections };
  /// Some sets and their points.
  struct Part {
    SetsOnPoints on;
    std::vector<std::uint32_t> points;                       ///< among the U, ascending
    std::vector<std::size_t> first;                          ///< per set of `on`: which of all it is
    std::vector<std::unique_ptr<const ConstraintSet>> made;  ///< with sections
  };

  /// As sections: circles all of whose points are on a cylinder of the part are told by that cylinder.
  Part part_of(const std::vector<std::size_t>& sets, Circles circles = Circles::apart) const;
  std::vector<Section> sections_of(std::size_t cylinder, const std::vector<std::size_t>& sets, std::vector<bool>& told) const;
  std::vector<std::vector<std::size_t>> connected(const std::vector<std::size_t>& sets) const;
  bool is_projected(const std::vector<std::size_t>& sets) const { return sets.size() == 1 && all_move_[sets[0]]; }
  void place_group(const std::vector<std::size_t>& sets, const std::vector<ShapeParameters>& shapes, Placed& placed,
                   const RunContext& context) const;
  void check_given_up(const std::vector<ShapeParameters>& shapes, Placed& placed) const;
  std::vector<Vec3> of_set(std::size_t t, const std::vector<Vec3>& points) const;

  std::vector<ConstraintSet> sets_;
  std::vector<std::vector<std::uint32_t>> places_;  ///< per set: its points among the U
  std::vector<bool> all_move_;                      ///< per set
  std::vector<PointId> ids_;
  std::vector<bool> moves_;  ///< U
};

}  // namespace deform
