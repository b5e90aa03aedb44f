// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "core/mesh/surface_mesh/surface_mesh.h"

namespace deform {

/// What isotropic_remeshing() makes.
struct RemeshingOptions {
  std::size_t vertices = 1000;  ///< how many the result has; 4 or more
  /// Edges whose faces meet at a larger angle between their normals stay sharp: points on them move along them only, corners not
  /// at all. Degrees, 0 to 180; 180: nothing is sharp.
  double feature_degrees = 45;
  int iterations = 10;  ///< rounds of splits, collapses, flips and smoothing; 1 to 1000
  /// So many of the planes through the origin across the first axes are symmetry planes, 0 to 3: edges whose ends both have the
  /// coordinate 0, exactly, stay in their plane, whatever the angle. Together they are a curve in which the surface that comes
  /// out can be cut; it is as coarse as the surface.
  std::size_t planes = 0;

  /// Throws Error(invalid_argument) naming field, value and limits.
  void validate() const;
};

/// A mesh of the same surface with nearly equilateral triangles of nearly the same size (thesis 3.4.1; M. Botsch, L. Kobbelt, A
/// remeshing approach to multiresolution modeling, 2004): edges longer than 4/3 of the target length are split, shorter than 4/5
/// collapsed, flips bring valences near 6, vertices move to the mean of their neighbours in their tangent planes and back on the
/// surface that came in. The target length follows the number of vertices asked for. All vertices lie on that surface, those on
/// sharp edges on these; the topology stays, no triangle turns over. Deterministic.
///
/// Surfaces of needles (wings meshed along their span) take long: needles are split all along before the pieces are collapsed.
///
/// The number of vertices is met within 5 % unless sharp edges need more of them. Throws Error(invalid_argument) as validate()
/// and check_closed_triangles() do.
SurfaceMesh isotropic_remeshing(const SurfaceMesh& mesh, const RemeshingOptions& options);

}  // namespace deform
