// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "core/mesh/mesh.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// Corners of one triangle of a fanned face, and the face.
struct Triangle {
  PointId corners[3];
  FaceId face;
};

/// The faces as triangles: a face of m > 3 corners is the fan of the corner from which its lowest triangle is highest (hanging
/// corners on a straight side give no flat triangles, a hollow quad is cut where it lies inside); of its first corner beyond 64
/// corners. Faces with fewer than three corners are left
/// out, and so are triangles that name a point twice. `faces`: only those with a nonzero entry; empty = all.
std::vector<Triangle> fan_triangles(const Mesh& mesh, const std::vector<char>& faces = {});

/// Differential operators on the triangles of a surface (Meyer et al. 2003; thesis 3.1 and 8.2), in coordinates divided by
/// `scale`. Free rims keep their rows: an edge with one triangle has one cotangent, an area is that of the triangles that are
/// there, which makes the normal derivative zero at a rim in the weak sense.
///
/// A triangle lower than `least_height` of its longest side has no usable angles. It counts as one of that height: the forms stay
/// positive semidefinite, and points that (nearly) coincide are tied together instead of torn apart.
struct ShellOperators {
  static constexpr double least_height = 1e-4;

  /// n x n, symmetric, both triangles stored: row i dotted with u is the integral of laplace u over the cell of point i, 1/2 sum
  /// of (cot + cot)(u_j - u_i). Negative semidefinite, zero on constants.
  SparseMatrix laplacian;
  /// n: mixed Voronoi areas; their sum is the area of the surface. 0 for points without a triangle.
  Eigen::VectorXd areas;
  std::size_t flat_triangles = 0;  ///< taken as higher than they are
  FaceId first_flat = 0;           ///< face of the first of them
};

/// Throws Error(invalid_argument) when scale is not positive and finite. Deterministic.
ShellOperators shell_operators(const Mesh& mesh, double scale, const std::vector<char>& faces = {});

/// G, 3 rows per triangle of fan_triangles(), n columns: gradient of the linear function on each triangle times the root of its
/// area, so that G^T G = -laplacian and |G u|^2 is the integral of |grad u|^2 (thesis eq. 8.6, 8.9).
SparseMatrix shell_gradient(const Mesh& mesh, double scale);

}  // namespace deform
