// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/quality/extreme.h"

namespace deform {

/// Measures of the elements of a 2D mesh: triangles and quads in a plane z = constant.
struct PlaneQuality {
  std::size_t elements = 0, left_handed = 0;
  /// The least, over the corners of a face, of the signed area that its edges span there over the product of their lengths, the
  /// sine of the angle: 1 for rectangles, 0.866 for the equilateral triangle (Knupp 2000; Verdict says 1 of that, too).
  Extreme least_scaled_jacobian;
  double average_scaled_jacobian = 0;
  std::size_t inverted_elements = 0;  ///< as InversionCheck has it
  /// Equiangle skewness: with E = 60 degrees for triangles and 90 for quads the larger of (largest angle - E) / (180 - E) and
  /// (E - least angle) / E; 0 for regular faces, 1 for collapsed ones and where an angle is reflex.
  Extreme largest_skewness;
  double average_skewness = 0;
  std::vector<std::size_t> worst;       ///< ids of the faces of least scaled Jacobian, worst first, at most 100
  std::vector<double> scaled_jacobian;  ///< of every face
};

/// points: n x 3; faces are those of the mesh, whose points do not count. left_handed: as left_handed_cells() has it. Parallel;
/// the result does not depend on the number of threads. Throws Error(invalid_argument) for faces with other than three or four
/// corners or without any, cancelled, deadline_exceeded.
PlaneQuality plane_quality(std::span<const Vec3> points, const Mesh& mesh, std::vector<char> left_handed,
                           const RunContext& context = {});

}  // namespace deform
