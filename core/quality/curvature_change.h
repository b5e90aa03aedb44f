// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "core/mesh/mesh.h"
#include "core/quality/extreme.h"
#include "core/quality/mean_curvature.h"

namespace deform {

/// What a deformation did to the mean curvature H of a surface (thesis 4.4), apart from sharp edges of the model itself: at their
/// ends H is an angle over the size of the faces and says nothing about smoothness.
struct CurvatureChange {
  std::vector<double> value;  ///< n, H after - H before, 1 / length; not a number where one of them is and at sharp edges
  /// Energy of the part of the change that is not smooth: the sum over the points of area times the square of the change less its
  /// mean over the neighbours along edges. Without a unit: the same for a model in metres and in millimetres. A surface that
  /// takes on ripples has a large one, one that bends smoothly a small one; rigid motions have none.
  double high_pass_energy = 0;
  std::size_t points = 0;  ///< that count: they and a neighbour have a change
  Extreme largest;         ///< change by magnitude
};

/// Edges at which the normals of two faces turn by more than this many degrees at rest are sharp.
inline constexpr double sharp_edge_degrees = 30;

/// `mesh` is at rest; neighbours are consecutive corners of a face. Both curvatures are those of its points; areas are those of
/// `before`. Throws Error(invalid_argument) when one of them has not as many points.
CurvatureChange curvature_change(const Mesh& mesh, const MeanCurvature& before, const MeanCurvature& after);

}  // namespace deform
