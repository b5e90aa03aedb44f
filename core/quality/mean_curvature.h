// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/adjacency.h"
#include "core/mesh/mesh.h"

namespace deform {

/// Discrete absolute mean curvature H = 1/2 |Laplace-Beltrami x| of every point (thesis 4.4; Meyer et al. 2003).
struct MeanCurvature {
  std::vector<double> value;  ///< n, 1 / length; not a number where a surface has none: see defined()
  std::vector<double> area;   ///< n, mixed area of the point; the areas of all points add up to that of the faces

  bool defined(std::size_t point) const { return !std::isnan(value[point]); }
};

/// Cotangent weights, Voronoi areas (halves and quarters in obtuse triangles). A polygon of more than three corners is the fan of
/// triangles around the mean of its corners, which moves with them and hands its area to them in equal parts (Bunge et al. 2020
/// with the mean as virtual point), so that no corner comes first. Triangles without area (below 1e-10 of their longest edge
/// squared) contribute nothing. Points with an edge that has not exactly two faces (boundary, non-manifold) or without area have
/// no curvature. `adjacency` is that of the mesh. Parallel; the same bits for any number of threads. Throws Error(cancelled),
/// deadline_exceeded.
MeanCurvature mean_curvature(const Mesh& mesh, const Adjacency& adjacency, const RunContext& context = {});

}  // namespace deform
