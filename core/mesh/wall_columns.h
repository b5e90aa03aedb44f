// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform {

inline constexpr int most_wall_layers = 1000;

/// Columns of cells on a wall, as layers of prisms and hexahedra are meshed on it (thesis 8.6.3).
///
/// A cell stands on one of its faces when it is a prism over it: another face, the opposite one, has as many corners and no point
/// in common with it, and all the others are quads that join the two edge by edge. Prisms stand on their triangles, hexahedra on
/// every face, linear and quadratic ones alike, and polyhedral cells on whatever fits; tetrahedra and pyramids on none. A column
/// is the cell on a face of the boundary, the cell behind its opposite face, and so on; it ends at the wall across, where the
/// next cell is of another kind, or where the next cell does not meet it in a whole face (hanging points).
struct WallColumns {
  std::vector<std::vector<PointId>> points;  ///< per column all points of its cells, mid-edge and mid-face nodes too; sorted
  std::size_t faces = 0;                     ///< of the boundary that have all corners in the set
  std::size_t shorter = 0;                   ///< columns of fewer cells than asked for
  std::size_t bare = 0;                      ///< faces without a column, because what is behind them does not stand on them
};

/// The columns of up to `layers` cells on all faces of the boundary whose corners are in the set `points` (in any order), in the
/// order of the faces of the cells, or of the elements and their faces. Where the mesh is thin, faces between two walls of the
/// set may have all corners in it too; columns from walls across each other may have the same cells. Throws
/// Error(invalid_argument) starting with `what`: layers not in 1..most_wall_layers, a point out of range, a mesh without cells,
/// no such face, no face with a column. O(faces) time and memory, however many layers.
WallColumns wall_columns(const Mesh& mesh, std::span<const PointId> points, int layers, const std::string& what = "wall");

}  // namespace deform
