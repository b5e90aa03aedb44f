#pragma once

#include <cstdint>
#include <span>

#include "core/base/types.h"

namespace deform {

/// The cells of a volume mesh as plain arrays, for ids, files and messages: elements by their nodes (types are the numbers of
/// ElementType), or cells by their faces (PolyhedralCells). Borrowed. Nothing is there: a surface.
struct CellsView {
  std::span<const std::uint8_t> element_types;
  std::span<const PointId> element_points;
  std::uint64_t cell_count = 0;  ///< of cells by faces
  std::span<const std::uint64_t> face_offsets;
  std::span<const PointId> face_points;
  std::span<const std::uint32_t> owner, neighbour;
  std::span<const char> empty_faces;

  bool any() const { return !element_types.empty() || cell_count != 0; }
};

}  // namespace deform
