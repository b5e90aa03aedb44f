// SPDX-License-Identifier: Apache-2.0
#include "proto/convert/mesh/geometry.h"

#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/inspect.h"

namespace deform::convert {

v1::GeometryInfo geometry_info(const Mesh& mesh, const std::string& id, const std::string& name) {
  v1::GeometryInfo info;
  info.set_id(id);
  info.set_name(name);
  info.set_points(mesh.point_count());
  info.set_faces(mesh.face_count());
  info.set_corners(mesh.face_points.size());
  const auto group_points = group_point_counts(mesh);
  for (std::size_t g = 0; g < mesh.groups.size(); ++g) {
    auto* entry = info.add_groups();
    entry->set_name(mesh.groups[g].name);
    entry->set_points(mesh.groups[g].points.size());
    entry->set_faces(mesh.groups[g].faces.size());
    entry->set_all_points(group_points[g]);
  }
  info.set_cells(mesh.cell_count());
  if (mesh.elements) info.set_cell_bytes(mesh.elements->bytes());
  if (mesh.cells) info.set_cell_bytes(mesh.cells->bytes());
  const Box box = bounding_box(mesh.points);
  for (int k = 0; k < 3; ++k) {
    info.add_box_min(box.min[k]);
    info.add_box_max(box.max[k]);
  }
  info.set_diagonal(box.diagonal());
  return info;
}

}  // namespace deform::convert
