// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/numerics/cage/cage.h"

namespace deform {

/// Mean value coordinates of a cage (Ju, Schaefer, Warren 2005, "Mean value coordinates for closed triangular meshes";
/// thesis 3.4):
///   w_i(x) = integral over the unit sphere around x of lambda_i(p) / |p - x|,  phi_i = w_i / sum of all,
/// where p is where the ray meets the cage, lambda_i the barycentric coordinate of vertex i there, and surfaces that the ray
/// leaves count with +, those that it enters with -. They add up to 1 and reproduce x everywhere, inside and outside, also in
/// cages that are not convex, where some are negative; on a face they are its barycentric coordinates, on a vertex 1 and 0.
/// Continuous everywhere, smooth off the cage.
///
/// What is integrated over a triangle is lambda_i(x') Q + grad lambda_i . M with the foot x' of x in its plane, Q the integral of
/// 1 / |p - x| and M that of (p - x') / |p - x|, which are sums over the sides. Beside a triangle, near its plane, the terms of Q
/// cancel and are replaced by their difference from the plane, so that no digits are lost there: the published formula divides by
/// the height and needs a threshold below which triangles are left out.
///
/// Off the cage the coordinates are right to about 1e-14 times the cube of the distance over the diagonal, where that is over 1.
/// Points within 4e-15 of the diagonal count as being on the cage. Immutable; any thread.
class MeanValue {
 public:
  /// The cage must outlive this.
  explicit MeanValue(const Cage& cage) : cage_(cage) {}

  /// An edge seen from a point: positions along its line count from the foot of the point.
  struct SideView {
    double angle = 0;       ///< that it takes in
    double per_length = 0;  ///< the angle over the distance from its line
    double product = 0;     ///< of the positions of its ends
    double squares = 0;     ///< sum of theirs
  };
  /// What computing takes, to be kept for the next points of a thread.
  struct Scratch {
    std::vector<Vec3> to;
    std::vector<double> distances;
    std::vector<SideView> sides;
  };

  /// out[i]: the coordinate of vertex i at x (model units), one per vertex.
  void evaluate(const Vec3& x, Scratch& scratch, std::span<double> out) const;

 private:
  const Cage& cage_;
};

}  // namespace deform
