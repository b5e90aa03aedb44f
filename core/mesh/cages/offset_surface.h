// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/mesh/remeshing/closest_point.h"

namespace deform {

/// The grid on which offset_surface() looks for the surface.
struct OffsetGrid {
  double offset = 0;  ///< distance of the surface from the triangles, model units, over 0
  double cell = 0;    ///< side of the cells of the grid, over 0 and at most offset
  /// So many of the planes through the origin across the first axes are symmetry planes of the triangles, 0 to 3. The surface is
  /// then the part where these coordinates are 0 or more, and ends in the planes, with points whose coordinate is exactly 0.
  std::size_t planes = 0;
  static constexpr std::size_t most_nodes = std::size_t{1} << 26;
};

/// The outer surface of all that is nearer than an offset to triangles, as a closed triangle 2-manifold that faces outwards:
/// where the distance, linear between the nodes of a grid, is the offset (marching tetrahedra over the Kuhn triangulation of the
/// cells). What it encloses has no cavities, so holes and gaps narrower than twice the offset are closed and what is behind them
/// is inside. It may have several components and handles. Exact distances are computed only near the surface. Deterministic.
///
/// triangles: at least one, with symmetry planes those of the whole model; box: theirs. Throws Error(invalid_argument) for
/// options out of their limits and a grid of more than most_nodes, Error(cancelled, deadline_exceeded) by the context.
Mesh offset_surface(const ClosestPoint& triangles, const Box& box, const OffsetGrid& grid, const RunContext& context = {});

/// Nodes of the grid around a box.
std::size_t offset_nodes(const Box& box, const OffsetGrid& grid);

}  // namespace deform
