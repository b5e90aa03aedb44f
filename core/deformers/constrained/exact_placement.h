// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained/constrained_points.h"

namespace deform {

/// Puts points on the shapes of some sets at once: the nearest points that are (least |y - x|^2 + W sum |y - P(y)|^2 with W =
/// 1e9). A set that shares no point with another and holds no point that may not move is projected. For the others Newton's
/// method with the linearized distances, each step as long as lowers that sum. What contradicts itself ends with the least
/// squares of the distances.
///
/// Sets that share points succeed or fail together. They are given up, and their points stay where they were, when the largest
/// distance that is left is neither met (1e-9) nor less than before, or a point is lost or moves too far: 3 times the largest
/// distance of all sets before and 1e-6, or 10 times when they are met, since the nearest place on several shapes at once, or on
/// one through points that are held, may be some times farther than each of them. Unit coordinates. Immutable; any thread.
class ExactPlacement {
 public:
  /// moves: per point of the mesh, whether it may.
  ExactPlacement(std::vector<ConstraintSet> sets, const std::vector<bool>& moves);

  /// U: the points of all sets, ascending.
  const std::vector<PointId>& ids() const { return ids_; }
  bool moves(std::size_t u) const { return moves_[u]; }
  std::size_t bytes() const;
  /// What place() and the derivatives take besides, at most: from the points at rest and a symbolic analysis.
  std::size_t working_bytes() const;

  struct Placed {
    std::vector<Vec3> from, points;  ///< U
    std::vector<bool> given_up;      ///< per set: its points stay where they come from
    double distance = 0;             ///< in `from`, largest over all sets
    bool met = true;                 ///< all that is not given up

    /// Whether any set is placed.
    bool any() const { return std::find(given_up.begin(), given_up.end(), false) != given_up.end(); }
    void give_up() {
      points = from;
      given_up.assign(given_up.size(), true);
    }
  };
  /// How far placing may move a point that is carried along.
  static double most_movement(const Placed& placed) { return most_movement(placed, placed.met); }
  Placed place(std::vector<Vec3> from, const RunContext& context) const;
  /// How points change with `from` (of those that may not move: with themselves): U from U. Conjugate gradients.
  std::vector<Vec3> derivative(const Placed& at, const std::vector<Vec3>& change, const RunContext& context) const;
  std::vector<Vec3> adjoint(const Placed& at, const std::vector<Vec3>& cotangent, const RunContext& context) const;

 private:
  class Joint;

  /// Sets that are connected by common points.
  struct Piece {
    std::vector<std::size_t> sets;
    std::vector<std::uint32_t> moving;  ///< points among the U that move, three unknowns each; none when `alone`
    bool alone = false;                 ///< one set, to be projected
  };

  void connect(const std::vector<int>& uses);
  std::vector<Vec3> of_set(std::size_t t, const std::vector<Vec3>& points) const;
  void project(std::size_t t, std::vector<Vec3>& points) const;
  void descend(const Piece& piece, const std::vector<Vec3>& from, std::vector<Vec3>& points, const RunContext& context) const;
  double merit(const Piece& piece, const std::vector<Vec3>& from, const std::vector<Vec3>& points) const;
  double largest_distance(const Piece& piece, const std::vector<Vec3>& points) const;
  static double most_movement(const Placed& placed, bool met) { return (met ? 10 : 3) * placed.distance + 1e-6; }
  bool is_worse(const Piece& piece, double before, double left, const Placed& placed) const;
  std::vector<Vec3> alone_derivative(const Placed& at, const std::vector<Vec3>& change) const;

  std::vector<ConstraintSet> sets_;
  std::vector<std::vector<std::uint32_t>> places_;  ///< per set: its points among the U
  std::vector<PointId> ids_;
  std::vector<bool> moves_;  ///< U
  std::vector<Piece> pieces_;
  std::vector<std::int64_t> unknown_;  ///< U: first unknown of a point that moves in its piece, else -1
};

}  // namespace deform
