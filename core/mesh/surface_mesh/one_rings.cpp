// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/surface_mesh/one_rings.h"

#include <numeric>

namespace deform {

OneRings::OneRings(const SurfaceMesh& mesh) {
  file_around_vertices(mesh);
  file_corners(mesh);
}

// Counting sorts over the half-edges, whose array is read from front to back, instead of walks around vertices.
void OneRings::file_around_vertices(const SurfaceMesh& mesh) {
  neighbour_offsets_.assign(mesh.vertex_slots() + 1, 0);
  face_offsets_.assign(mesh.vertex_slots() + 1, 0);
  for (const HalfedgeHandle h : mesh.halfedges()) {
    const std::uint32_t v = mesh.target(h).index();
    ++neighbour_offsets_[v + 1];
    if (!mesh.is_boundary(h)) ++face_offsets_[v + 1];
  }
  std::partial_sum(neighbour_offsets_.begin(), neighbour_offsets_.end(), neighbour_offsets_.begin());
  std::partial_sum(face_offsets_.begin(), face_offsets_.end(), face_offsets_.begin());
  neighbours_.resize(neighbour_offsets_.back());
  faces_.resize(face_offsets_.back());
  std::vector<std::uint32_t> next_neighbour(neighbour_offsets_.begin(), neighbour_offsets_.end() - 1);
  std::vector<std::uint32_t> next_face(face_offsets_.begin(), face_offsets_.end() - 1);
  for (const HalfedgeHandle h : mesh.halfedges()) {
    const std::uint32_t v = mesh.target(h).index();
    neighbours_[next_neighbour[v]++] = mesh.source(h);
    if (!mesh.is_boundary(h)) faces_[next_face[v]++] = mesh.face(h);
  }
}

void OneRings::file_corners(const SurfaceMesh& mesh) {
  corner_offsets_.assign(mesh.face_slots() + 1, 0);
  corners_.reserve(faces_.size());
  std::uint32_t last = 0;
  for (const FaceHandle f : mesh.faces()) {
    while (last < f.index()) corner_offsets_[++last] = static_cast<std::uint32_t>(corners_.size());
    for (const HalfedgeHandle h : mesh.halfedges(f)) corners_.push_back(mesh.target(h));
  }
  while (last < mesh.face_slots()) corner_offsets_[++last] = static_cast<std::uint32_t>(corners_.size());
}

std::size_t OneRings::bytes() const {
  return sizeof(std::uint32_t) * (neighbour_offsets_.capacity() + face_offsets_.capacity() + corner_offsets_.capacity() +
                                  neighbours_.capacity() + corners_.capacity() + faces_.capacity());
}

}  // namespace deform
