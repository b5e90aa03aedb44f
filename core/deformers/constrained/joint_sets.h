// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained/linearized_sets.h"

namespace deform {

/// The nearest points that are on the shapes of several sets at once: least |y - x|^2 with y = P_t(y) for all sets t, while some
/// points are held.
///
/// Gauss-Newton steps with the rank revealed (LinearizedSets): the limits follow the misfit, since shapes that coincide in the
/// end (the plane of a circle on a plane) differ by an angle of about the misfit over their size before. Steps are no longer than
/// points may move in all, and are halved until the distances that are left fall or are below half the step. Sets are met when
/// the steps have ended, all distances are below 5e-10, no point has moved too far, and the rank has not changed after the first
/// step: where it does (a circle that has to turn square to its cylinder, which no distance says to first order) positions would
/// hang on rounding.
///
/// Derivatives: with the tangent space T of all sets at y, the forces f_t that add up to x - y and the curvatures S_t of the sets
/// along these, (T - T sum S_t T) dy = T dx by conjugate gradients. S_t comes from the derivative of the projection, which is
/// (1 - s S_t)^-1 at y + s f_t. Unit coordinates. Immutable; any thread.
class JointSets {
 public:
  static constexpr double met = 5e-10;  ///< a distance; half of what counts as missed, since the points of a pair share theirs

  explicit JointSets(SetsOnPoints on) : on_(std::move(on)) {}

  struct State {
    std::vector<Vec3> points;
    std::vector<ShapeParameters> shapes;    ///< per set
    std::vector<std::vector<Vec3>> forces;  ///< per set and point of it
    std::vector<double> distances;          ///< per set: largest that is left
    bool found = false;                     ///< the sets are met
  };
  /// most: how far a point may move. shapes: of `from`. Of the iterates the one with the least distances.
  State place(const std::vector<Vec3>& from, const std::vector<ShapeParameters>& shapes, double most,
              const RunContext& context) const;
  /// The change of all points from that of `from`, where points that do not move change by what is given.
  std::vector<Vec3> derivative(const State& at, const std::vector<Vec3>& change, const RunContext& context) const;
  std::vector<Vec3> adjoint(const State& at, const std::vector<Vec3>& cotangent, const RunContext& context) const;
  /// What placing takes at the points.
  std::size_t working_bytes(const std::vector<Vec3>& points, const RunContext& context) const;

 private:
  class Iteration;
  LinearizedSets linearized(const State& at, const RunContext& context) const;
  std::vector<Vec3> curved(const State& at, const std::vector<Vec3>& change) const;
  std::vector<Vec3> tangent_solution(const State& at, const LinearizedSets& sets, const std::vector<Vec3>& right,
                                     const RunContext& context) const;

  const SetsOnPoints on_;
};

/// The largest distance of points from the shape of a set; `shape` becomes that of the fit.
double largest_distance(const ConstraintSet& set, const std::vector<Vec3>& x, ShapeParameters& shape);

}  // namespace deform
