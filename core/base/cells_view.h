// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "core/base/types.h"

namespace deform {

/// The cells of a volume mesh as plain arrays, for ids, files and messages: elements by their nodes (types are the numbers of
/// ElementType), or cells by their faces (PolyhedralCells). Borrowed. Nothing is there: a surface.
struct CellsView {
  std::span<const std::uint8_t> element_types;  ///< per element the number of its ElementType
  std::span<const PointId> element_points;      ///< nodes of all elements, one element after the other
  std::uint64_t cell_count = 0;                 ///< of cells by faces
  std::span<const std::uint64_t> face_offsets;  ///< where the corners of each face begin in face_points, and the end
  std::span<const PointId> face_points;         ///< corners of all faces; the normal points out of the owner
  std::span<const std::uint32_t> owner;         ///< per face the cell behind it
  std::span<const std::uint32_t> neighbour;     ///< per internal face, which stand first, the cell before it
  std::span<const char> empty_faces;            ///< per face 1 across which a 2D mesh has no extent; or none at all

  /// Whether there are cells of either kind.
  bool any() const { return !element_types.empty() || cell_count != 0; }
};

}  // namespace deform
