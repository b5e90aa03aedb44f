// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"
#include "deform/v1/service.pb.h"

namespace deform::server {

/// A wavy sheet of columns x rows points, quads, in the unit square, with point groups "left" and "right" (two columns each) and
/// the face group "all". `salt` makes it another geometry.
inline Mesh sheet_mesh(std::size_t columns, std::size_t rows, double salt = 0) {
  Mesh mesh;
  for (std::size_t j = 0; j < rows; ++j) {
    for (std::size_t i = 0; i < columns; ++i) {
      const double x = static_cast<double>(i) / static_cast<double>(columns - 1);
      const double y = static_cast<double>(j) / static_cast<double>(rows - 1);
      mesh.points.push_back({x, y, 0.05 * std::sin(7 * x + salt) * std::cos(5 * y)});
    }
  }
  Group left{"left", {}, {}}, right{"right", {}, {}}, all{"all", {}, {}};
  for (std::size_t j = 0; j < rows; ++j) {
    for (std::size_t i = 0; i < columns; ++i) {
      const auto id = static_cast<PointId>(j * columns + i);
      if (i < 2) left.points.push_back(id);
      if (i + 2 >= columns) right.points.push_back(id);
      if (i + 1 == columns || j + 1 == rows) continue;
      all.faces.push_back(static_cast<FaceId>(mesh.face_sizes.size()));
      mesh.face_sizes.push_back(4);
      const auto step = static_cast<PointId>(columns);
      for (const PointId corner : {id, id + 1, id + step + 1, id + step}) mesh.face_points.push_back(corner);
    }
  }
  mesh.groups = {left, right, all};
  return mesh;
}

template <typename T>
std::string raw_bytes(const std::vector<T>& array, std::size_t first, std::size_t count) {
  return {reinterpret_cast<const char*>(array.data() + first), count * sizeof(T)};
}

inline v1::GeometryHeader header_of(const Mesh& mesh, const std::string& name = "sheet") {
  v1::GeometryHeader header;
  header.set_point_count(mesh.points.size());
  header.set_face_count(mesh.face_sizes.size());
  header.set_corner_count(mesh.face_points.size());
  header.set_group_count(static_cast<std::uint32_t>(mesh.groups.size()));
  header.set_name(name);
  if (mesh.elements) {
    header.mutable_cells()->set_elements(mesh.elements->size());
    header.mutable_cells()->set_element_points(mesh.elements->points.size());
  } else if (mesh.cells) {
    header.mutable_cells()->set_cells(mesh.cells->cell_count);
    header.mutable_cells()->set_faces(mesh.cells->face_count());
    header.mutable_cells()->set_face_points(mesh.cells->face_points.size());
    header.mutable_cells()->set_internal_faces(mesh.cells->internal_faces());
    header.mutable_cells()->set_empty_faces(!mesh.cells->empty_faces.empty());
  }
  return header;
}

/// An array of the cells, `chunk` entries a message.
template <typename T>
void add_cells(std::vector<v1::RegisterGeometryRequest>& messages, const std::vector<T>& array, std::size_t chunk,
               std::string* (v1::CellChunk::*field)()) {
  for (std::size_t i = 0; i < array.size(); i += chunk) {
    *(messages.emplace_back().mutable_cells()->*field)() = raw_bytes(array, i, std::min(chunk, array.size() - i));
  }
}

inline void add_cells(std::vector<v1::RegisterGeometryRequest>& messages, const Mesh& mesh, std::size_t chunk) {
  if (mesh.elements) {
    add_cells(messages, mesh.elements->types, chunk, &v1::CellChunk::mutable_element_types);
    add_cells(messages, mesh.elements->points, chunk, &v1::CellChunk::mutable_element_points);
  } else if (mesh.cells) {
    std::vector<std::uint32_t> sizes;
    for (std::size_t f = 0; f < mesh.cells->face_count(); ++f) {
      sizes.push_back(static_cast<std::uint32_t>(mesh.cells->face(f).size()));
    }
    add_cells(messages, sizes, chunk, &v1::CellChunk::mutable_face_sizes);
    add_cells(messages, mesh.cells->face_points, chunk, &v1::CellChunk::mutable_face_points);
    add_cells(messages, mesh.cells->owner, chunk, &v1::CellChunk::mutable_owners);
    add_cells(messages, mesh.cells->neighbour, chunk, &v1::CellChunk::mutable_neighbours);
    add_cells(messages, mesh.cells->empty_faces, chunk, &v1::CellChunk::mutable_empty_faces);
  }
}

/// The messages after the header, `chunk` entries each.
inline std::vector<v1::RegisterGeometryRequest> upload_messages(const Mesh& mesh, std::size_t chunk = 1000) {
  std::vector<v1::RegisterGeometryRequest> messages;
  for (std::size_t i = 0; i < mesh.points.size(); i += chunk) {
    const std::size_t count = std::min(chunk, mesh.points.size() - i);
    messages.emplace_back().mutable_points()->set_xyz(raw_bytes(mesh.points, i, count));
  }
  std::size_t corner = 0;
  for (std::size_t i = 0; i < mesh.face_sizes.size(); i += chunk) {
    const std::size_t count = std::min(chunk, mesh.face_sizes.size() - i);
    std::size_t corners = 0;
    for (std::size_t f = i; f < i + count; ++f) corners += mesh.face_sizes[f];
    corners = std::min(corners, mesh.face_points.size() - corner);  // the sizes may be wrong on purpose
    v1::FaceChunk& faces = *messages.emplace_back().mutable_faces();
    faces.set_sizes(raw_bytes(mesh.face_sizes, i, count));
    faces.set_corners(raw_bytes(mesh.face_points, corner, corners));
    corner += corners;
  }
  for (const auto& group : mesh.groups) {
    v1::GroupChunk& head = *messages.emplace_back().mutable_group();
    head.set_name(group.name);
    for (std::size_t i = 0; i < group.points.size(); i += chunk) {
      messages.emplace_back().mutable_group()->set_points(raw_bytes(group.points, i, std::min(chunk, group.points.size() - i)));
    }
    for (std::size_t i = 0; i < group.faces.size(); i += chunk) {
      messages.emplace_back().mutable_group()->set_faces(raw_bytes(group.faces, i, std::min(chunk, group.faces.size() - i)));
    }
  }
  add_cells(messages, mesh, chunk);
  return messages;
}

/// Left fixed, right a handle with two variables.
inline v1::Setup sheet_setup(const std::string& geometry_id) {
  v1::Setup setup;
  setup.set_geometry(geometry_id);
  setup.mutable_method()->mutable_rbf()->set_kernel(v1::TRIHARMONIC);
  auto* handle = setup.add_handles();
  handle->set_name("right");
  handle->mutable_region()->set_group("right");
  setup.add_fixed()->set_group("left");
  auto* up = setup.add_variables();
  up->set_name("up");
  up->set_handle("right");
  for (const double x : {0., 0., 1.}) up->add_translate(x);
  up->set_lower(-0.5);
  up->set_upper(0.5);
  auto* turn = setup.add_variables();
  turn->set_name("turn");
  turn->set_handle("right");
  for (const double x : {0., 1., 0.}) turn->mutable_rotate()->add_axis(x);
  for (const double x : {1., 0., 0.}) turn->mutable_rotate()->add_centre(x);
  return setup;
}

}  // namespace deform::server
