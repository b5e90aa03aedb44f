// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/lattice/spline_axis.h"

namespace deform {

/// The parallelepiped origin + u_0 axes[0] + u_1 axes[1] + u_2 axes[2] with u in [0, 1]^3; the axes need be neither of unit
/// length nor orthogonal, but independent.
struct LatticeFrame {
  Vec3 origin{};
  std::array<Vec3, 3> axes{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
};

/// A point of a lattice: the functions that are not zero there and their values along each axis.
struct LatticeWeights {
  std::array<std::size_t, 3> first{};
  std::array<std::array<double, SplineAxis::most_order>, 3> along{};
};

/// Free-form deformation (thesis 3.2): x(u) = sum_p c_p phi_p(u) over a lattice of control points c_p, where phi_p is a product
/// of splines along the three axes. Control point (i, j, k) has the number i + l (j + m k) in a lattice of l x m x n. At rest the
/// control points are where x(u) is the frame itself (Greville abscissae), so that local coordinates are affine. The deformation
/// is defined inside the frame only; control points of LatticeBasis::uniform_cubic stand one span outside of it. Immutable; any
/// thread.
class Lattice {
 public:
  /// Control points at rest. Throws Error(invalid_argument): axes that are not independent or not finite, what SplineAxis throws.
  Lattice(const LatticeFrame& frame, const std::array<std::size_t, 3>& points, LatticeBasis basis);

  const LatticeFrame& frame() const { return frame_; }
  const SplineAxis& axis(std::size_t k) const { return axes_[k]; }
  std::size_t size() const { return axes_[0].size() * axes_[1].size() * axes_[2].size(); }
  std::size_t number(std::size_t i, std::size_t j, std::size_t k) const {
    return i + axes_[0].size() * (j + axes_[1].size() * k);
  }
  /// Functions that are not zero at a point, at most.
  std::size_t cover() const { return axes_[0].order() * axes_[1].order() * axes_[2].order(); }
  /// Greville abscissae of a control point, and where it is at rest.
  Vec3 abscissae(std::size_t number) const;
  Vec3 control_point(std::size_t number) const { return place(abscissae(number)); }
  std::vector<Vec3> control_points() const;

  /// The point of the frame with these coordinates, and the coordinates of a point; unlimited.
  Vec3 place(const Vec3& u) const;
  Vec3 coordinates(const Vec3& x) const;
  /// Coordinates limited to [0, 1], or nothing for points outside (by more than 1e-12 of the frame: rounding).
  std::optional<Vec3> inside(const Vec3& x) const;

  /// u in [0, 1]^3; derivatives of that order along each axis.
  LatticeWeights weights(const Vec3& u, const std::array<std::size_t, 3>& derivatives = {0, 0, 0}) const;
  /// use(number, weight) for all functions that are not zero at u, numbers ascending.
  template <typename Use>
  void for_each(const LatticeWeights& at, const Use& use) const {
    for (std::size_t k = 0; k < axes_[2].order(); ++k) {
      for (std::size_t j = 0; j < axes_[1].order(); ++j) {
        const double weight = at.along[1][j] * at.along[2][k];
        const std::size_t start = number(at.first[0], at.first[1] + j, at.first[2] + k);
        for (std::size_t i = 0; i < axes_[0].order(); ++i) use(start + i, at.along[0][i] * weight);
      }
    }
  }
  /// sum_p values[p] phi_p(u), or a derivative of it with respect to u; one value per control point.
  Vec3 sum(std::span<const Vec3> values, const Vec3& u, const std::array<std::size_t, 3>& derivatives = {0, 0, 0}) const;

 private:
  LatticeFrame frame_;
  std::array<SplineAxis, 3> axes_;
  std::array<Vec3, 3> dual_;  ///< of the axes: u_k = dual_k . (x - origin)
};

/// The local coordinates of points in a lattice, in [0, 1]^3.
struct LatticeCoordinates {
  std::vector<Vec3> u;                 ///< per point; meaningless for those outside
  std::vector<std::uint32_t> outside;  ///< ascending
};

/// Where points lie in a lattice at rest. In parallel.
LatticeCoordinates coordinates_in(const Lattice& lattice, std::span<const Vec3> points, const RunContext& context = {});

}  // namespace deform
