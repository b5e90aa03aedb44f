// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/boundary_triangles.h"

#include <span>

#include "core/mesh/elements.h"

namespace deform::cad {

namespace {

/// 1 for the nodes of quadratic elements that are no corners; empty when there are none.
std::vector<char> middle_nodes(const Mesh& mesh) {
  std::vector<char> middle;
  if (!mesh.elements) return middle;
  for (std::size_t i = 0; i < mesh.elements->size(); ++i) {
    const ElementShape& form = shape(mesh.elements->types[i]);
    if (!form.quadratic()) continue;
    if (middle.empty()) middle.assign(mesh.point_count(), 0);
    for (const PointId node : mesh.elements->nodes(i).subspan(form.corners)) middle[node] = 1;
  }
  return middle;
}

bool alternates(std::span<const PointId> face, const std::vector<char>& middle) {
  if (middle.empty() || face.size() < 6 || face.size() % 2 != 0) return false;
  for (std::size_t i = 0; i < face.size(); ++i) {
    if (middle[face[i]] != static_cast<char>(i % 2)) return false;
  }
  return true;
}

}  // namespace

std::vector<std::array<PointId, 3>> boundary_triangles(const Mesh& mesh) {
  const std::vector<char> middle = middle_nodes(mesh);
  std::vector<std::array<PointId, 3>> triangles;
  std::size_t first = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    const std::span<const PointId> face(mesh.face_points.data() + first, size);
    first += size;
    if (alternates(face, middle)) {
      for (std::size_t i = 0; i < size; i += 2) triangles.push_back({face[(i + size - 1) % size], face[i], face[i + 1]});
      for (std::size_t i = 3; i + 2 < size; i += 2) triangles.push_back({face[1], face[i], face[i + 2]});
    } else {
      for (std::size_t k = 1; k + 1 < size; ++k) triangles.push_back({face[0], face[k], face[k + 1]});
    }
  }
  return triangles;
}

}  // namespace deform::cad
