// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace deform::quality {

/// Two cells with a common side.
struct CellLink {
  std::uint32_t a = 0, b = 0;
  /// Their nodes run around the side in opposite directions: both cells are right-handed or both left-handed wherever neither is
  /// inverted.
  bool consistent = true;
};

/// What the positions of its nodes say of a cell: positive, the mirror image of a positive one, or neither.
enum class Orientation : signed char { mirrored = -1, neither = 0, positive = 1 };

/// Which cells are left-handed, one entry per cell; empty when none is.
///
/// A block is what consistent links connect. It is left-handed when more of its cells are mirrored than positive. A block of
/// fewer than 10 cells that links of both kinds connect with others is no block of a mesh but a mistake in it: its cells are as
/// most of all that is connected. So a mesh that was mirrored as a whole or in part keeps its cells, single cells with their
/// nodes in a wrong order do not change what is right around them, and a cell that is turned inside out amid its block stays
/// inverted.
std::vector<char> left_handed_cells(std::span<const Orientation> cells, std::span<const CellLink> links);

/// The links of polygons or polyhedra that are given by their sides. Sides of the same nodes are common; what more than two cells
/// have is none.
class SideLinks {
 public:
  /// A side of a cell by two or more nodes in their order around it; those after the three smallest do not count.
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
