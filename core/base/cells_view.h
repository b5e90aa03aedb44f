// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "core/base/types.h"

namespace deform {

/// A non-owning view of the cells of a volume mesh as plain arrays, for ids, files and messages. The cells are given either as
/// elements by their nodes (Elements) or by their faces (PolyhedralCells). All arrays are empty for a surface mesh.
struct CellsView {
  std::span<const std::uint8_t> element_types;  ///< ElementType of each element, as its number
  std::span<const PointId> element_points;      ///< nodes of all elements, element by element
  std::uint64_t cell_count = 0;                 ///< number of cells given by faces
  std::span<const std::uint64_t> face_offsets;  ///< faces + 1 offsets into face_points
  std::span<const PointId> face_points;         ///< corners of all faces; normals point out of the owner
  std::span<const std::uint32_t> owner;         ///< owner cell of each face
  std::span<const std::uint32_t> neighbour;     ///< neighbour cell of each internal face; these come first
  std::span<const char> empty_faces;            ///< 1 for each face of type "empty" (2D meshes); may be empty

  /// Whether there are cells of either kind.
  bool any() const { return !element_types.empty() || cell_count != 0; }
};

}  // namespace deform
