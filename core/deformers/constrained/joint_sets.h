// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained/linearized_sets.h"

namespace deform {

/// Finds the nearest points on the shapes of several sets at once: minimizes |y - x|^2 subject to y = P_t(y) for all sets t, with
/// some points fixed.
///
/// Uses Gauss-Newton steps with a rank-revealing decomposition (LinearizedSets). The rank thresholds follow the misfit, because
/// shapes that coincide at the solution (the plane of a circle on a plane) differ by an angle of about the misfit over their size
/// before. Steps are limited by the largest allowed movement, and halved until the remaining distances decrease or are below half
/// the step. The sets are satisfied if the iteration has ended, all distances are below 5e-10, no point has moved too far, and
/// the rank has not changed after the first step. If it changes (a circle that must become perpendicular to its cylinder, which
/// no distance expresses to first order), positions would depend on rounding.
///
/// Derivatives: with the projection T onto the tangent space of all sets at y, the forces f_t that add up to x - y, and the
/// curvatures S_t of the sets along these forces, (T - T sum S_t T) dy = T dx is solved by conjugate gradients. S_t comes from
/// the derivative of the projection, which is (1 - s S_t)^-1 at y + s f_t. Unit coordinates. Immutable; any thread.
class JointSets {
 public:
  /// The largest distance of a satisfied set: half of what is reported as missed, because the points of a pair share theirs.
  static constexpr double satisfied_distance = 5e-10;

  explicit JointSets(SetsOnPoints on) : on_(std::move(on)) {}

  struct State {
    std::vector<Vec3> points;
    std::vector<ShapeParameters> shapes;    ///< shape of each set
    std::vector<std::vector<Vec3>> forces;  ///< forces of each set at its points
    std::vector<double> distances;          ///< largest remaining distance of each set
    bool found = false;                     ///< whether the sets are satisfied
  };
  /// Returns the iterate with the smallest distances. `shapes` are those fitted to `from`, `most` is the largest movement of
  /// a point.
  State place(const std::vector<Vec3>& from, const std::vector<ShapeParameters>& shapes, double most,
              const RunContext& context) const;
  /// The derivative of all points with respect to `from`; fixed points change by the given values.
  std::vector<Vec3> derivative(const State& at, const std::vector<Vec3>& change, const RunContext& context) const;
  std::vector<Vec3> adjoint(const State& at, const std::vector<Vec3>& cotangent, const RunContext& context) const;
  /// The memory of place() at the points, in bytes.
  std::size_t working_bytes(const std::vector<Vec3>& points, const RunContext& context) const;

 private:
  class Iteration;
  LinearizedSets linearized(const State& at, const RunContext& context) const;
  std::vector<Vec3> curved(const State& at, const std::vector<Vec3>& change) const;
  std::vector<Vec3> tangent_solution(const State& at, const LinearizedSets& sets, const std::vector<Vec3>& right,
                                     const RunContext& context) const;

  const SetsOnPoints on_;
};

/// The largest distance of the points from the fitted shape of a set, whose parameters are stored in `shape`.
double largest_distance(const ConstraintSet& set, const std::vector<Vec3>& x, ShapeParameters& shape);

}  // namespace deform
