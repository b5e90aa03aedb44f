// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// The cells of a volume mesh, given by their faces as in finite-volume solvers (OpenFOAM's polyMesh). Every face has an owner
/// cell. Internal faces come first and have a neighbour cell; their normals point from the owner to the neighbour. Immutable by
/// convention once validated: any thread may read.
struct PolyhedralCells {
  std::vector<std::uint64_t> face_offsets{0};  ///< f + 1: face i has corners face_points[face_offsets[i] .. face_offsets[i+1])
  std::vector<PointId> face_points;            ///< corners, face by face
  std::vector<std::uint32_t> owner;            ///< f
  std::vector<std::uint32_t> neighbour;        ///< one per internal face
  std::size_t cell_count = 0;                  ///< c
  std::vector<char> empty_faces;               ///< f or 0; nonzero for faces of patches of type "empty" (2D meshes)

  std::size_t face_count() const { return face_offsets.size() - 1; }  ///< f
  std::size_t internal_faces() const { return neighbour.size(); }     ///< number of internal faces
  std::span<const PointId> face(std::size_t i) const {                ///< corners of face i
    return std::span(face_points).subspan(face_offsets[i], static_cast<std::size_t>(face_offsets[i + 1] - face_offsets[i]));
  }
  std::size_t bytes() const;  ///< memory of the arrays

  /// Throws Error(invalid_argument) naming the array, index and limit: array lengths that do not match, corners, owners or
  /// neighbours out of range, a face without corners, no cell.
  void validate(std::size_t points) const;
};

}  // namespace deform
