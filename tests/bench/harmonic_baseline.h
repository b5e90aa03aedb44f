// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/SparseCholesky>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/elements.h"

namespace deform::bench {

/// What FEMWARP does (Shontz, Vavasis 2010; thesis 7.2 compares with it): every coordinate of the displacement is a discrete
/// harmonic function with the displacements of the boundary points as its values there. Linear elements on tetrahedra, trilinear
/// ones with 2 x 2 x 2 Gauss points on hexahedra; sparse Cholesky of the points inside. To compare with, not for production.
/// Immutable; any thread.
class HarmonicBaseline {
 public:
  /// points: n x 3; boundary: ascending ids. Throws Error(invalid_argument) for other elements and ids out of range,
  /// numerical_failure when an element without volume or too many inverted ones leave a singular matrix.
  HarmonicBaseline(std::span<const Vec3> points, const Elements& elements, std::span<const PointId> boundary);

  /// displacements: one per boundary point, in their order. n x 3.
  Points deformed(std::span<const Vec3> displacements) const;

 private:
  using Sparse = Eigen::SparseMatrix<double>;

  std::vector<Vec3> points_;
  std::vector<PointId> boundary_;
  std::vector<PointId> inside_;  ///< the others, ascending
  Sparse coupling_;              ///< inside x boundary
  Eigen::SimplicialLDLT<Sparse> factor_;
};

}  // namespace deform::bench
