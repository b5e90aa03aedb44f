// SPDX-License-Identifier: Apache-2.0
#include "core/io/assembly/mesh_stream.h"

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"

namespace deform::io {

namespace {

enum Cells : std::uint64_t { no_cells, by_nodes, by_faces };

template <typename T>
void put(const std::vector<T>& values, ByteWriter& to) {
  to.array(std::span<const T>(values));
}

/// Group names must be in the form that FaceGroups gives them; a stream with others was not written by our reader.
void check_name(std::string_view name) {
  while (!name.empty()) {
    const std::size_t length = utf8_length(name);
    if (length == 0) throw Error(ErrorCode::data_loss, "the name of a group is no UTF-8");
    name.remove_prefix(length);
  }
}

}  // namespace

void write_mesh(const Mesh& mesh, ByteWriter& to) {
  put(mesh.points, to);
  put(mesh.face_sizes, to);
  put(mesh.face_points, to);
  to.number(mesh.groups.size());
  for (const Group& group : mesh.groups) {
    to.text(group.name);
    put(group.points, to);
    put(group.faces, to);
  }
  to.number(mesh.elements ? by_nodes : mesh.cells ? by_faces : no_cells);
  if (mesh.elements) {
    put(mesh.elements->types, to);
    put(mesh.elements->offsets, to);
    put(mesh.elements->points, to);
  } else if (mesh.cells) {
    put(mesh.cells->face_offsets, to);
    put(mesh.cells->face_points, to);
    put(mesh.cells->owner, to);
    put(mesh.cells->neighbour, to);
    to.number(mesh.cells->cell_count);
    put(mesh.cells->empty_faces, to);
  }
}

Mesh read_mesh(ByteReader& from) {
  Mesh mesh;
  mesh.points = from.array<Vec3>();
  mesh.face_sizes = from.array<std::uint32_t>();
  mesh.face_points = from.array<PointId>();
  for (std::uint64_t left = from.number(); left > 0; --left) {
    Group group;
    group.name = from.text();
    check_name(group.name);
    group.points = from.array<PointId>();
    group.faces = from.array<FaceId>();
    mesh.groups.push_back(std::move(group));
  }
  const std::uint64_t kind = from.number();
  if (kind > by_faces) throw Error(ErrorCode::data_loss, "cells of an unknown kind");
  if (kind == by_nodes) {
    Elements elements;
    elements.types = from.array<ElementType>();
    elements.offsets = from.array<std::uint64_t>();
    elements.points = from.array<PointId>();
    mesh.elements = std::make_shared<const Elements>(std::move(elements));
  } else if (kind == by_faces) {
    PolyhedralCells cells;
    cells.face_offsets = from.array<std::uint64_t>();
    cells.face_points = from.array<PointId>();
    cells.owner = from.array<std::uint32_t>();
    cells.neighbour = from.array<std::uint32_t>();
    cells.cell_count = static_cast<std::size_t>(from.number());
    cells.empty_faces = from.array<char>();
    // Later steps allocate memory for each face of a cell.
    if (cells.cell_count > cells.owner.size() + cells.neighbour.size()) {
      throw Error(ErrorCode::invalid_argument, std::to_string(cells.cell_count) + " cells are more than their faces have sides");
    }
    mesh.cells = std::make_shared<const PolyhedralCells>(std::move(cells));
  }
  mesh.validate();
  return mesh;
}

}  // namespace deform::io
