// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <TopoDS_Face.hxx>
#include <TopoDS_Shape.hxx>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform::cad {

// Models that the tests make by OpenCASCADE, and meshes of them.

TopoDS_Shape block(const Vec3& corner, const Vec3& size);
TopoDS_Shape rod(const Vec3& start, const Vec3& axis, double radius, double height);
TopoDS_Shape rod(const Vec3& start, const Vec3& axis, const Vec3& seam, double radius, double height);
TopoDS_Shape without(const TopoDS_Shape& shape, const TopoDS_Shape& tool);
TopoDS_Shape joined(const TopoDS_Shape& a, const TopoDS_Shape& b);  ///< faces on one surface stay apart
TopoDS_Shape smoothed(const TopoDS_Shape& shape);                   ///< faces on one surface become one
TopoDS_Shape turned(const TopoDS_Shape& shape, const Vec3& centre, const Vec3& axis, double degrees);
TopoDS_Shape shifted(const TopoDS_Shape& shape, const Vec3& by);
TopoDS_Shape scaled(const TopoDS_Shape& shape, double factor);
TopoDS_Shape mirrored(const TopoDS_Shape& shape, const Vec3& normal);  ///< in the plane through the origin
TopoDS_Shape together(const std::vector<TopoDS_Shape>& shapes);

std::vector<TopoDS_Face> faces_of(const TopoDS_Shape& shape);
/// The same solid of faces in another order: `step` and the number of faces have no common divisor.
TopoDS_Shape renumbered(const TopoDS_Shape& shape, int step);
/// A shell of the faces but those given, the ones in `turned_round` the other way round.
TopoDS_Shape sheet(const TopoDS_Shape& shape, const std::vector<int>& left_out, const std::vector<int>& turned_round);

/// A block from the origin with a bore along z through `at`.
TopoDS_Shape bored(const Vec3& size, const Vec3& at, double radius);
/// A plate with four bores along z at x = first, first + 2, ...
TopoDS_Shape row_of_bores(double first);

/// A pipe of two straight legs along z and a bend between them in the plane y = 0.
struct PipeSizes {
  double inner = 0.7, outer = 1, bend = 3, degrees = 90, first_leg = 2, second_leg = 2;
};
TopoDS_Shape pipe(const PipeSizes& sizes);

/// Triangles with corners on the model: those of OpenCASCADE, each face on its own, which have all corners on edges where a face
/// is flat, then split at a point inside as often as said.
Mesh mesh_of(const TopoDS_Shape& shape, double deflection, int splits = 2);

/// The faces without the inside of solids.
TopoDS_Shape skin(const TopoDS_Shape& shape);

/// Distance of a point from a shape, by a search that knows nothing of (u, v).
double distance_from(const Vec3& point, const TopoDS_Shape& shape);
double diagonal_of(const TopoDS_Shape& shape);

}  // namespace deform::cad
