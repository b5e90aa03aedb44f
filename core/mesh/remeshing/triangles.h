// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/base/types.h"
#include "core/mesh/surface_mesh/surface_mesh.h"

namespace deform {

// What remeshing asks about the triangles of a mesh.

/// Throws Error(invalid_argument) naming the first face or edge: a face that is no triangle, an edge on a boundary.
void check_closed_triangles(const SurfaceMesh& mesh);

/// Twice the area as the length, outwards. Model units squared.
Vec3 area_normal(const SurfaceMesh& mesh, FaceHandle f);

/// Whether a triangle at the source of h that does not also have the target would turn over, or nearly collapse, when the source
/// moves to x: by more than about 78 degrees, or to a hundredth of the height of an equilateral one.
bool would_fold(const SurfaceMesh& mesh, HalfedgeHandle h, const Vec3& x);
/// The same of all triangles of a vertex that moves to x.
bool would_fold(const SurfaceMesh& mesh, VertexHandle v, const Vec3& x);

/// The smallest angle of all triangles, in degrees. 180 without any.
double least_angle(const SurfaceMesh& mesh);
/// The mean over all triangles of their smallest angles, in degrees.
double mean_least_angle(const SurfaceMesh& mesh);

/// The smallest angle of a triangle, in degrees; 0 when two corners coincide.
double least_angle(const Vec3& a, const Vec3& b, const Vec3& c);

}  // namespace deform
