// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "core/base/types.h"
#include "core/mesh/remeshing/closest_point.h"

namespace deform {

using SymmetricMatrix = std::array<Vec3, 3>;

/// Eigenvalues of a symmetric matrix, ascending, and its orthonormal eigenvectors.
struct Eigenvectors {
  Vec3 values{};
  std::array<Vec3, 3> vectors{};
};
/// By Jacobi's method.
Eigenvectors eigenvectors(SymmetricMatrix matrix);

/// m += factor (a b' + b a') / 2.
void add_product(SymmetricMatrix& m, double factor, const Vec3& a, const Vec3& b);

/// The centroid of triangles and their second moments about it, those of the area or, where there is none, of the corners.
struct PrincipalAxes {
  Box box;        ///< of the corners
  Vec3 centre{};  ///< the centroid, model units
  /// Second moments along the axes, ascending, in any unit, and the axes: mirror planes of the triangles are across eigenvectors.
  Eigenvectors moments;
};
/// There must be a triangle.
PrincipalAxes principal_axes(std::span<const TriangleCorners> triangles);

}  // namespace deform
