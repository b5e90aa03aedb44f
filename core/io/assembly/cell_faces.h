// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/cells.h"

namespace deform::io {

/// The cells of a mesh, each with all of its faces, oriented outwards; a face between two cells occurs twice.
struct CellFaces {
  std::vector<std::uint64_t> cell_offsets{0};  ///< cells + 1 offsets into the faces
  std::vector<std::uint64_t> face_offsets{0};  ///< faces + 1 offsets into `points`
  std::vector<PointId> points;

  std::size_t cell_count() const { return cell_offsets.size() - 1; }
  std::size_t face_count() const { return face_offsets.size() - 1; }
  std::span<const PointId> face(std::size_t i) const {
    return std::span(points).subspan(face_offsets[i], static_cast<std::size_t>(face_offsets[i + 1] - face_offsets[i]));
  }
  void add_face(std::span<const PointId> corners);
  void end_cell() { cell_offsets.push_back(face_count()); }
};

/// Converts the cells to owner and neighbour form; the first of the two cells of a face is its owner. Throws
/// Error(invalid_argument) if a face belongs to more than two cells, or twice to one.
PolyhedralCells joined(const CellFaces& cells);

}  // namespace deform::io
