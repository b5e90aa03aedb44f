// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/quality/extreme.h"

namespace deform {

/// Quality measures of the elements of a 2D mesh: triangles and quads in a plane z = constant.
struct PlaneQuality {
  std::size_t elements = 0;     ///< number of faces
  std::size_t left_handed = 0;  ///< number of clockwise faces
  /// The scaled Jacobian of a face is the minimum over its corners of the sine of the angle: the signed area spanned by the two
  /// edges, divided by the product of their lengths (Knupp 2000). It is 1 for rectangles and 0.866 for the equilateral triangle
  /// (Verdict normalizes the latter to 1).
  Extreme least_scaled_jacobian;
  double average_scaled_jacobian = 0;  ///< over the faces
  std::size_t inverted_elements = 0;   ///< as in InversionCheck
  /// The equiangle skewness is the larger of (largest angle - E) / (180 - E) and (E - smallest angle) / E, where E = 60 degrees
  /// for triangles and 90 for quads. It is 0 for regular faces, and 1 for collapsed faces and those with a reflex angle.
  Extreme largest_skewness;
  double average_skewness = 0;          ///< over the faces
  std::vector<std::size_t> worst;       ///< ids of the faces of least scaled Jacobian, worst first, at most 100
  std::vector<double> scaled_jacobian;  ///< values of all faces
};

/// Measures the faces of `mesh` over `points` (n x 3), which replace its own. `left_handed` is the result of left_handed_cells().
/// Parallel; the result does not depend on the number of threads. Throws Error(invalid_argument) if there is no face or one does
/// not have three or four corners, cancelled, deadline_exceeded.
PlaneQuality plane_quality(std::span<const Vec3> points, const Mesh& mesh, std::vector<char> left_handed,
                           const RunContext& context = {});

}  // namespace deform
