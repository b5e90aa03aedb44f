// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// One triangle of a triangulated face.
struct Triangle {
  PointId corners[3];
  FaceId face;
};

/// Triangulates the faces: those with more than three corners as a fan around their fan_apex() (core/mesh/polygon_fan.h). Faces
/// with fewer than three corners are left out, and so are triangles that repeat a point. `faces` is a mask of the faces to use;
/// empty means all.
std::vector<Triangle> fan_triangles(const Mesh& mesh, const std::vector<char>& faces = {});

/// Differential operators on the triangles of a surface (Meyer et al. 2003; thesis 3.1 and 8.2), in coordinates divided by
/// `scale`. Rows of boundary points are kept: a boundary edge has one cotangent and an area counts the existing triangles only,
/// which is the natural (zero normal derivative) boundary condition in the weak sense.
///
/// A triangle whose height is below `least_height` times its longest side has no usable angles and is treated as one of that
/// height. So the forms stay positive semidefinite, and points that (nearly) coincide move together.
struct ShellOperators {
  static constexpr double least_height = 1e-4;

  /// n x n, symmetric with both triangles stored, negative semidefinite, zero on constants. Row i times u is the integral of the
  /// Laplacian of u over the cell of point i: 1/2 sum over j of (cot + cot)(u_j - u_i).
  SparseMatrix laplacian;
  /// n mixed Voronoi areas, 0 for points without a triangle. Their sum is the area of the surface.
  Eigen::VectorXd areas;
  std::size_t flat_triangles = 0;  ///< triangles below least_height
  FaceId first_flat = 0;           ///< face of the first one
  /// The part of the area, 0 to 1, in triangles whose longest side is more than `stretched` times their height.
  double stretched_area = 0;
  static constexpr double stretched = 5;
};

/// Assembles the operators. Throws Error(invalid_argument) if scale is not positive and finite, and the errors of
/// RunContext::check(). Deterministic.
ShellOperators shell_operators(const Mesh& mesh, double scale, const std::vector<char>& faces = {},
                               const RunContext& context = {});

/// The gradient matrix G with 3 rows per triangle of fan_triangles() and n columns: the gradient of the piecewise linear function
/// on each triangle, times the square root of its area. So G^T G = -laplacian and |G u|^2 is the integral of |grad u|^2 (thesis
/// eq. 8.6, 8.9).
SparseMatrix shell_gradient(const Mesh& mesh, double scale);

}  // namespace deform
