// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <vector>

#include "core/base/types.h"
#include "core/codec/geometry_id.h"
#include "deform/v1/geometry.pb.h"
#include "tests/wire/vectors.h"

namespace deform::wire {

namespace {

using Ids = std::vector<std::uint32_t>;

struct NamedGroup {
  std::string name;
  Ids points, faces;
};

/// The arrays of a geometry as the contract has them.
struct Arrays {
  std::string name;
  Points points;
  Ids face_sizes, corners;
  std::vector<NamedGroup> groups;
  std::vector<std::uint8_t> element_types;
  Ids element_points;
  std::uint64_t cells = 0;
  Ids cell_face_sizes, cell_corners, owners, neighbours;
  std::vector<char> empty_faces;

  std::string id() const {
    std::vector<codec::GroupView> views;
    for (const NamedGroup& group : groups) views.push_back({group.name, group.points, group.faces});
    std::vector<std::uint64_t> offsets;
    if (cells > 0) offsets.push_back(0);
    for (const std::uint32_t size : cell_face_sizes) offsets.push_back(offsets.back() + size);
    CellsView view;
    view.element_types = element_types;
    view.element_points = element_points;
    view.cell_count = cells;
    view.face_offsets = offsets;
    view.face_points = cell_corners;
    view.owner = owners;
    view.neighbour = neighbours;
    view.empty_faces = empty_faces;
    return codec::geometry_id({points, face_sizes, corners, views, view});
  }
};

template <typename T>
std::string bytes_of(std::span<const T> numbers) {
  return {reinterpret_cast<const char*>(numbers.data()), numbers.size_bytes()};
}

/// Cuts an array into chunks of `length` entries and hands their bytes to add().
template <typename T, typename Add>
void in_chunks(const std::vector<T>& array, std::size_t length, const Add& add) {
  for (std::size_t first = 0; first < array.size(); first += length) {
    add(bytes_of(std::span(array).subspan(first, std::min(length, array.size() - first))));
  }
}

using Messages = std::vector<v1::RegisterGeometryRequest>;

v1::GeometryHeader header_of(const Arrays& arrays) {
  v1::GeometryHeader header;
  header.set_point_count(arrays.points.size());
  header.set_face_count(arrays.face_sizes.size());
  header.set_corner_count(arrays.corners.size());
  header.set_group_count(static_cast<std::uint32_t>(arrays.groups.size()));
  header.set_name(arrays.name);
  if (arrays.element_types.empty() && arrays.cells == 0) return header;
  v1::CellCounts& cells = *header.mutable_cells();
  cells.set_elements(arrays.element_types.size());
  cells.set_element_points(arrays.element_points.size());
  cells.set_cells(arrays.cells);
  cells.set_faces(arrays.cell_face_sizes.size());
  cells.set_face_points(arrays.cell_corners.size());
  cells.set_internal_faces(arrays.neighbours.size());
  cells.set_empty_faces(!arrays.empty_faces.empty());
  return header;
}

/// As a client may send them, with chunks of few entries.
Messages messages_of(const Arrays& arrays, std::size_t length) {
  Messages messages(1);
  *messages[0].mutable_header() = header_of(arrays);
  const auto next = [&messages]() -> v1::RegisterGeometryRequest& { return messages.emplace_back(); };
  in_chunks(arrays.points, length, [&](const std::string& bytes) { next().mutable_points()->set_xyz(bytes); });
  in_chunks(arrays.face_sizes, length, [&](const std::string& bytes) { next().mutable_faces()->set_sizes(bytes); });
  in_chunks(arrays.corners, length, [&](const std::string& bytes) { next().mutable_faces()->set_corners(bytes); });
  for (const NamedGroup& group : arrays.groups) {
    next().mutable_group()->set_name(group.name);
    in_chunks(group.points, length, [&](const std::string& bytes) { next().mutable_group()->set_points(bytes); });
    in_chunks(group.faces, length, [&](const std::string& bytes) { next().mutable_group()->set_faces(bytes); });
  }
  in_chunks(arrays.element_types, length, [&](const auto& bytes) { next().mutable_cells()->set_element_types(bytes); });
  in_chunks(arrays.element_points, length, [&](const auto& bytes) { next().mutable_cells()->set_element_points(bytes); });
  in_chunks(arrays.cell_face_sizes, length, [&](const auto& bytes) { next().mutable_cells()->set_face_sizes(bytes); });
  in_chunks(arrays.cell_corners, length, [&](const auto& bytes) { next().mutable_cells()->set_face_points(bytes); });
  in_chunks(arrays.owners, length, [&](const auto& bytes) { next().mutable_cells()->set_owners(bytes); });
  in_chunks(arrays.neighbours, length, [&](const auto& bytes) { next().mutable_cells()->set_neighbours(bytes); });
  in_chunks(arrays.empty_faces, length, [&](const auto& bytes) { next().mutable_cells()->set_empty_faces(bytes); });
  return messages;
}

/// The corners of 2 x 1 x 1 unit cubes: point x + 3 y + 6 z.
Points two_cubes() {
  Points points;
  for (int i = 0; i < 12; ++i)
    points.push_back({static_cast<double>(i % 3), static_cast<double>(i / 3 % 2), static_cast<double>(i / 6)});
  return points;
}

Arrays surface() {
  Arrays arrays;
  arrays.name = "surface";
  for (int i = 0; i < 9; ++i) arrays.points.push_back({0.1 * (i % 3), 0.3 * (i / 3), 0.01 * i * i});
  arrays.points.push_back(arrays.points[4]);  // coincident with another point, and of no face
  arrays.face_sizes = {4, 4, 4, 3, 3};
  arrays.corners = {0, 1, 4, 3, 1, 2, 5, 4, 3, 4, 7, 6, 4, 5, 8, 4, 8, 7};
  arrays.groups = {{"edge", {2, 5, 8}, {}},
                   {"d\xC3\xA9"
                    "but",
                    {0, 0, 3},
                    {0, 2}},
                   {"empty", {}, {}}};
  return arrays;
}

Arrays points_only() {
  Arrays arrays;
  arrays.name = "points only";
  arrays.points = {{0.0, -0.0, 1.0 / 3}, {1e40, -1e-300, 4e-324}};
  return arrays;
}

Arrays elements() {
  Arrays arrays;
  arrays.name = "elements";
  arrays.points = two_cubes();
  arrays.points.push_back({0.5, 0.5, 2});
  arrays.face_sizes = {4};
  arrays.corners = {0, 1, 4, 3};
  arrays.groups = {{"floor", {}, {0}}};
  arrays.element_types = {3, 2, 1};  // hexahedron, prism, pyramid
  arrays.element_points = {0, 1, 4, 3, 6, 7, 10, 9, 1, 2, 4, 7, 8, 10, 6, 7, 10, 9, 12};
  return arrays;
}

/// The cube at x = 0 and half of the other one, a prism, by their faces.
Arrays polyhedra() {
  Arrays arrays;
  arrays.name = "polyhedra";
  arrays.points = two_cubes();
  arrays.cells = 2;
  arrays.cell_face_sizes = {4, 4, 4, 4, 4, 4, 4, 4, 3, 3};
  arrays.cell_corners = {1, 4, 10, 7,  0, 6, 9, 3, 0, 1, 7, 6,  3, 9, 10, 4, 0, 3, 4,
                         1, 6, 7,  10, 9, 1, 2, 8, 7, 2, 4, 10, 8, 1, 4,  2, 7, 8, 10};
  arrays.owners = {0, 0, 0, 0, 0, 0, 1, 1, 1, 1};
  arrays.neighbours = {1};
  arrays.empty_faces = {0, 0, 0, 0, 1, 1, 0, 0, 1, 1};
  return arrays;
}

}  // namespace

void add_upload_vectors(Vectors& vectors) {
  Json& file = vectors["uploads.json"] = Json::array();
  for (const Arrays& arrays : {surface(), points_only(), elements(), polyhedra()}) {
    Json json;
    json["name"] = arrays.name;
    json["id"] = arrays.id();
    for (const auto& message : messages_of(arrays, 5)) json["messages"].push_back(base64(message.SerializeAsString()));
    file.push_back(json);
  }
}

}  // namespace deform::wire
