// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/cgns/cgns_zone.h"

namespace deform::io {

namespace {

std::int64_t length(const CgnsZone& zone, std::size_t axis) { return axis < zone.vertices.size() ? zone.vertices[axis] : 1; }

PointId vertex(const CgnsZone& zone, const std::array<std::int64_t, 3>& at) {
  return zone.first_point + static_cast<PointId>(at[0] + length(zone, 0) * (at[1] + length(zone, 1) * at[2]));
}

/// The corners of the cell at `cell` in the order of a quad (two axes) or of a hexahedron (three).
std::vector<PointId> corners(const CgnsZone& zone, const std::array<std::int64_t, 3>& cell) {
  constexpr std::int64_t steps[8][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
  std::vector<PointId> result;
  for (std::size_t c = 0; c < (zone.vertices.size() == 3 ? 8 : 4); ++c) {
    result.push_back(vertex(zone, {cell[0] + steps[c][0], cell[1] + steps[c][1], cell[2] + steps[c][2]}));
  }
  return result;
}

}  // namespace

std::vector<PointId> cgns_lattice_face(const CgnsZone& zone, std::size_t axis, const std::array<std::int64_t, 3>& cell) {
  const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
  for (const std::size_t k : {axis, u, v}) {
    if (cell[k] < 0 || cell[k] >= length(zone, k) - (k == axis ? 0 : 1)) return {};
  }
  constexpr std::int64_t steps[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  std::vector<PointId> result;
  for (const auto& step : steps) {
    auto at = cell;
    at[u] += step[0];
    at[v] += step[1];
    result.push_back(vertex(zone, at));
  }
  return result;
}

void read_cgns_lattice(const CgnsTree& tree, CgnsZone& zone, CgnsMesh& mesh) {
  if (zone.vertices.size() == 1) return;
  std::array<std::int64_t, 3> cells{1, 1, 1};
  for (std::size_t axis = 0; axis < zone.vertices.size(); ++axis) cells[axis] = zone.vertices[axis] - 1;
  if (!tree.children(zone.node, "Elements_t").empty()) tree.fail(zone.node, "a structured zone with elements");
  CgnsNamedSet faces{FaceGroups::Kind::section, zone.name, {}};
  for (std::int64_t k = 0; k < cells[2]; ++k) {
    for (std::int64_t j = 0; j < cells[1]; ++j) {
      for (std::int64_t i = 0; i < cells[0]; ++i) {
        const auto nodes = corners(zone, {i, j, k});
        if (zone.vertices.size() == 3) {
          mesh.elements.elements.add(ElementType::hexahedron, nodes);
          mesh.elements.volume_names.push_back(zone.name);
        } else {
          faces.elements.push_back({CgnsElement::Kind::face, static_cast<std::uint32_t>(mesh.elements.faces.size())});
          mesh.elements.add_face(nodes, "");
        }
      }
    }
  }
  if (!faces.elements.empty()) mesh.sets.push_back(std::move(faces));
}

}  // namespace deform::io
