// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/adjacency.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The discrete absolute mean curvature H = 1/2 |Laplace-Beltrami x| of each point (thesis 4.4; Meyer et al. 2003).
struct MeanCurvature {
  std::vector<double> value;  ///< n, in 1 / length; NaN where it is undefined, see defined()
  std::vector<double> area;   ///< n, mixed areas of the points; they add up to the area of the faces

  /// Whether a point has a curvature.
  bool defined(std::size_t point) const { return !std::isnan(value[point]); }
};

/// Uses cotangent weights and Voronoi areas (halves and quarters in obtuse triangles). A polygon with more than three corners is
/// a fan of triangles around the mean of its corners, a virtual point whose area is distributed equally to the corners (Bunge et
/// al. 2020), so that no corner is preferred. Triangles with an area below 1e-10 of their squared longest edge are ignored. The
/// curvature is undefined at points with an edge that does not have exactly two faces (boundary, non-manifold) and at points
/// without area. `adjacency` is that of the mesh. Runs in parallel; bitwise independent of the number of threads. Throws
/// Error(cancelled), deadline_exceeded.
MeanCurvature mean_curvature(const Mesh& mesh, const Adjacency& adjacency, const RunContext& context = {});

}  // namespace deform
