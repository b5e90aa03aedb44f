#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained_solver.h"

namespace deform {

/// Puts points on the shapes of some sets at once: the nearest points that are (least |y - x|^2 + W sum |y - P(y)|^2 with W =
/// 1e9). A set that shares no point with another and holds no point that may not move is projected. For the others Newton's
/// method with the linearized distances. What contradicts itself ends with the least squares of the distances. Unit coordinates.
/// Immutable; any thread.
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
    std::vector<double> distances;   ///< per set, largest that is left
  };
  Placed place(std::vector<Vec3> from, const RunContext& context) const;
  /// How points change with `from` (of those that may not move: with themselves): U from U. Conjugate gradients.
  std::vector<Vec3> derivative(const Placed& at, const std::vector<Vec3>& change, const RunContext& context) const;
  std::vector<Vec3> adjoint(const Placed& at, const std::vector<Vec3>& cotangent, const RunContext& context) const;

 private:
  class Joint;

  std::vector<Vec3> of_set(std::size_t t, const std::vector<Vec3>& points) const;
  void project_alone(std::vector<Vec3>& points) const;
  double largest_distance(std::size_t t, const std::vector<Vec3>& points) const;
  std::vector<Vec3> alone_derivative(const Placed& at, const std::vector<Vec3>& change) const;

  std::vector<ConstraintSet> sets_;
  std::vector<std::vector<std::uint32_t>> places_;  ///< per set: its points among the U
  std::vector<bool> alone_;                         ///< per set: to be projected
  std::vector<PointId> ids_;
  std::vector<bool> moves_;            ///< U
  std::vector<std::int64_t> unknown_;  ///< U: first unknown of a point of the joint sets that moves, else -1
  std::int64_t unknowns_ = 0;          ///< 3 per such point
  bool joint_ = false;                 ///< whether some set is not alone
};

}  // namespace deform
