// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace deform::quality {

/// A common side of two cells.
struct CellLink {
  std::uint32_t a = 0, b = 0;
  /// Whether the nodes of the cells run around the side in opposite directions. If so, both cells are right-handed or both are
  /// left-handed, unless one is inverted.
  bool consistent = true;
};

/// The orientation of a cell from the positions of its nodes: positive, the mirror image of a positive cell, or neither.
enum class Orientation : signed char { mirrored = -1, neither = 0, positive = 1 };

/// Finds the left-handed cells: one entry for each cell, or empty if there are none.
///
/// Cells connected by consistent links form a block, which is left-handed if more of its cells are mirrored than positive. A
/// block of fewer than 10 cells that has links of both kinds to others counts as an error in the mesh: its cells get the
/// handedness of the majority of the connected component. So a mesh that was mirrored as a whole or in part is accepted, single
/// cells with nodes in wrong order do not affect their neighbours, and a cell turned inside out within its block stays inverted.
std::vector<char> left_handed_cells(std::span<const Orientation> cells, std::span<const CellLink> links);

/// Collects the links of polygons or polyhedra given by their sides. Two cells are linked by sides with the same nodes; sides of
/// more than two cells are ignored.
class SideLinks {
 public:
  /// Adds a side of a cell by its two or more nodes in order around it. Sides are identified by their three smallest nodes.
  void add(std::uint32_t cell, std::span<const std::uint32_t> nodes);
  std::vector<CellLink> links() &&;
  static std::size_t bytes_for(std::size_t sides);

 private:
  struct Side {
    std::uint32_t key[3];
    std::uint32_t cell;
    bool forward;
  };
  std::vector<Side> sides_;
};

}  // namespace deform::quality
