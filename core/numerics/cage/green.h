// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/numerics/cage/cage.h"

namespace deform {

/// Green coordinates of a cage (Lipman, Levin, Cohen-Or 2008, "Green coordinates"): Green's third identity for the functions x, y
/// and z inside the cage,
///   x = sum over vertices of phi_i(x) v_i + sum over triangles of psi_j(x) n_j,
///   phi_i(x) = 1 / (4 pi) integral of hat_i(y) n . (y - x) / |y - x|^3 over the triangles of vertex i,
///   psi_j(x) = 1 / (4 pi) integral of 1 / |y - x| over triangle j,
/// with the outward unit normals n_j and the linear hat functions hat_i of the vertices. The phi_i add up to 1. Both are harmonic
/// inside the cage and continuous up to it.
///
/// The paper prints a closed form that loses half of the digits next to edges. Here the integrals are those of a linear double
/// layer and a constant single layer (Wilton et al. 1984): with the height h of the plane over x, the foot x' of x in it, the
/// solid angle W of the triangle (Van Oosterom and Strackee 1983), and for each side its inward normal m_e, the distance t_e of
/// x' from it and L_e = integral of 1 / |y - x| along it,
///   4 pi phi_i = sum over triangles of hat_i(x') W + h sum over sides of grad hat_i . m_e L_e,
///   4 pi psi_j = sum over sides of t_e L_e - h W.
/// Next to an edge the solid angles of its two triangles have large rounding errors of opposite signs. All solid angles of a
/// closed cage add up to a multiple of 4 pi, and what they miss is returned to the triangles next to x.
///
/// Inside the cage the coordinates are right to about 1e-14 of the diagonal, times the ratio of the diagonal to the least
/// altitude of a triangle where that is over 10. Immutable; any thread.
class Green {
 public:
  /// The cage must outlive this.
  explicit Green(const Cage& cage) : cage_(cage) {}

  /// An edge seen from a point.
  struct SideView {
    double inverse = 0;   ///< integral of 1 / |y - x| along it
    double distance = 0;  ///< of the point from the edge
  };
  /// What computing takes, to be kept for the next points of a thread.
  struct Scratch {
    std::vector<Vec3> to;
    std::vector<double> distances;
    std::vector<SideView> sides;
    std::vector<FaceView> views;
    std::vector<double> angles;      ///< solid angles of the triangles
    std::vector<double> nearness;    ///< of the triangles: large where the solid angle is uncertain
    std::vector<std::size_t> under;  ///< triangles on which the point is
  };

  /// The coordinates of x (model units): phi without unit for each vertex, psi in model units for each triangle. Returns the
  /// winding number of the cage around x: the coordinates are those of x where it is 1. Points on the cage, up to rounding, have
  /// the limits from inside.
  int evaluate(const Vec3& x, Scratch& scratch, std::span<double> phi, std::span<double> psi) const;

 private:
  const Cage& cage_;
};

}  // namespace deform
