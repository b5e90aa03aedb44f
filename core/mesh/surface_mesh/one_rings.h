// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/mesh/surface_mesh/surface_mesh.h"

namespace deform {

/// A snapshot of the connectivity of a SurfaceMesh for sweeps: the one-rings of all vertices and the corners of all faces as
/// compressed rows. Removed entities have empty rows. Immutable; any number of threads may read.
class OneRings {
 public:
  explicit OneRings(const SurfaceMesh& mesh);

  /// The vertices connected with v by edges, ordered by the index of the edge and not around the vertex.
  std::span<const VertexHandle> neighbours(VertexHandle v) const { return row(neighbours_, neighbour_offsets_, v.index()); }
  /// The faces around v, ordered by the index of their half-edges that end in v.
  std::span<const FaceHandle> faces(VertexHandle v) const { return row(faces_, face_offsets_, v.index()); }
  /// The corners of f, counter-clockwise, from the target of its first half-edge.
  std::span<const VertexHandle> corners(FaceHandle f) const { return row(corners_, corner_offsets_, f.index()); }
  /// Isolated vertices count as boundary, as in SurfaceMesh.
  bool is_boundary(VertexHandle v) const { return neighbours(v).empty() || neighbours(v).size() != faces(v).size(); }
  std::size_t bytes() const;

 private:
  template <typename T>
  static std::span<const T> row(const std::vector<T>& values, const std::vector<std::uint32_t>& offsets, std::uint32_t i) {
    return {values.data() + offsets[i], values.data() + offsets[i + 1]};
  }
  void file_around_vertices(const SurfaceMesh& mesh);
  void file_corners(const SurfaceMesh& mesh);

  std::vector<std::uint32_t> neighbour_offsets_, face_offsets_, corner_offsets_;
  std::vector<VertexHandle> neighbours_, corners_;
  std::vector<FaceHandle> faces_;
};

}  // namespace deform
