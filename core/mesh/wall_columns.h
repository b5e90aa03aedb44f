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

/// Columns of cells on a wall, such as boundary layers of prisms and hexahedra (thesis 8.6.3).
///
/// A cell stands on one of its faces if it is a prism over that face: an opposite face has the same number of corners and no
/// point in common with it, and all other faces are quads that join the two edge by edge. Prisms stand on their triangles,
/// hexahedra on any face, both linear and quadratic, and polyhedral cells on any face that fits; tetrahedra and pyramids stand on
/// none. A column consists of the cell on a boundary face, the cell behind its opposite face, and so on. It ends at the opposite
/// wall, at a cell that is no prism over the common face, or where cells do not share a whole face (hanging nodes).
struct WallColumns {
  /// The corners of the cells of a column.
  struct Stack {
    std::size_t sides = 0;         ///< corners of the wall face
    std::vector<PointId> corners;  ///< those of the wall face in order around it, then those above them, level by level

    std::size_t layers() const { return corners.size() / sides - 1; }
  };
  std::vector<std::vector<PointId>> points;  ///< points of the cells of each column with mid-edge and mid-face nodes, sorted
  std::vector<Stack> stacks;                 ///< of each column
  std::size_t faces = 0;                     ///< boundary faces with all corners in the set
  std::size_t shorter = 0;                   ///< columns of fewer cells than requested
  std::size_t bare = 0;                      ///< faces without a column, because the cell behind does not stand on them
};

/// The columns of up to `layers` cells on all boundary faces whose corners are in the set `points` (in any order), in the order
/// of the faces of the cells, or of the elements and their faces. In a thin mesh, faces between two walls of the set may have all
/// corners in it too, and columns from opposite walls may share cells. Throws Error(invalid_argument) with a message that starts
/// with `what`: layers not in 1..most_wall_layers, a point out of range, a mesh without cells, no such face, no face with a
/// column. O(faces) time and memory for any number of layers.
WallColumns wall_columns(const Mesh& mesh, std::span<const PointId> points, int layers, const std::string& what = "wall");

}  // namespace deform
