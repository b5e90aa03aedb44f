// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "core/base/run_context.h"
#include "core/constraints/sections.h"
#include "core/deformers/constrained/constrained_points.h"
#include "core/deformers/constrained/joint_sets.h"

namespace deform {

/// Moves points onto the shapes of the given sets, to the nearest points on them. A set that shares no point with another and
/// contains no fixed point is projected; the others are placed by JointSets.
///
/// No point moves farther than 3 times the largest initial distance of all sets plus 1e-6, and no final error of a set, as
/// Projection::misfit() reports it, exceeds the largest initial one. Sets that cannot be placed under these conditions are given
/// up, the worst first, until the others can be placed: first those that contradict fixed points, then those that contradict
/// other sets. A set that is given up keeps its points, except those that it shares with placed sets. Unit coordinates.
/// Immutable; any thread.
class ExactPlacement {
 public:
  /// `moves` tells for each point of the mesh whether it may move. The result is deterministic, bit for bit, for the same sets in
  /// the same order.
  ExactPlacement(std::vector<ConstraintSet> sets, const std::vector<bool>& moves);

  /// U: the points of all sets, ascending.
  const std::vector<PointId>& ids() const { return ids_; }
  bool moves(std::size_t u) const { return moves_[u]; }
  std::size_t bytes() const;
  /// An upper bound of the additional memory of place() and the derivatives, computed at the rest points.
  std::size_t working_bytes(const RunContext& context) const;

  /// Sets that are placed together because they share points.
  struct Group {
    std::vector<std::size_t> sets;
    JointSets::State at;  ///< for the points of the group; forces are empty for a projected set
    bool projected = false;
    bool sectioned = false;  ///< circles are treated as sections of their cylinders
  };
  struct Placed {
    std::vector<Vec3> from, points;  ///< U
    std::vector<bool> given_up;      ///< for each set
    std::vector<Group> groups;       ///< the placed sets
    double distance = 0;             ///< largest initial distance of a point from its shape over all sets
    double misfit = 0;               ///< largest initial Projection::Misfit::largest over all sets

    /// Whether any set is placed.
    bool any() const { return !groups.empty(); }
    void give_up() {
      points = from;
      groups.clear();
      given_up.assign(given_up.size(), true);
    }
    /// The largest allowed movement of a point.
    double most_movement() const { return 3 * distance + 1e-6; }
  };
  /// `before` has a shape for each set that was fitted to points nearby. Fits start from these, so that errors are those that
  /// reports show, or anew where they are empty.
  Placed place(std::vector<Vec3> from, const std::vector<ShapeParameters>& before, const RunContext& context) const;
  Placed place(std::vector<Vec3> from, const RunContext& context) const;
  /// The derivative of the points with respect to `from` (for fixed points the identity): U from U.
  std::vector<Vec3> derivative(const Placed& at, const std::vector<Vec3>& change, const RunContext& context) const;
  std::vector<Vec3> adjoint(const Placed& at, const std::vector<Vec3>& cotangent, const RunContext& context) const;

 private:
  enum class Circles { apart, sections };
  /// Several sets and their points.
  struct Part {
    SetsOnPoints on;
    std::vector<std::uint32_t> points;                       ///< positions among the U, ascending
    std::vector<std::size_t> first;                          ///< number of each set of `on` among all sets
    std::vector<std::unique_ptr<const ConstraintSet>> made;  ///< owned sets with sections
  };

  /// With Circles::sections, circles whose points are all on a cylinder of the part become sections of that cylinder.
  Part part_of(const std::vector<std::size_t>& sets, Circles circles = Circles::apart) const;
  struct Sections {
    std::vector<Section> all;
    std::optional<double> curvature;  ///< that the cylinder keeps, or one of them
  };
  Sections sections_of(std::size_t cylinder, const std::vector<std::size_t>& sets, std::vector<bool>& in_section) const;
  std::vector<std::vector<std::size_t>> connected(const std::vector<std::size_t>& sets) const;
  bool is_projected(const std::vector<std::size_t>& sets) const { return sets.size() == 1 && all_move_[sets[0]]; }
  void place_group(const std::vector<std::size_t>& sets, const std::vector<ShapeParameters>& shapes, Placed& placed,
                   const RunContext& context) const;
  void check_given_up(const std::vector<ShapeParameters>& before, Placed& placed) const;
  std::vector<Vec3> of_set(std::size_t t, const std::vector<Vec3>& points) const;

  std::vector<ConstraintSet> sets_;
  std::vector<std::vector<std::uint32_t>> places_;  ///< points of each set, as positions among the U
  std::vector<bool> all_move_;                      ///< for each set
  std::vector<PointId> ids_;
  std::vector<bool> moves_;  ///< U
};

}  // namespace deform
