// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/mesh.h"

#include <cmath>
#include <limits>
#include <unordered_set>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/mesh/cells.h"
#include "core/mesh/coordinate_limits.h"
#include "core/mesh/elements.h"

namespace deform {

namespace {

constexpr std::uint64_t max_count = std::numeric_limits<std::uint32_t>::max();

[[noreturn]] void refuse(const std::string& message) { throw Error(ErrorCode::invalid_argument, "mesh: " + message); }

std::string number(std::uint64_t value) { return std::to_string(value); }

void check_points(const Points& points) {
  if (points.empty()) refuse("points: there must be at least one point");
  if (points.size() > max_count) refuse("points: " + number(points.size()) + " points, the limit is " + number(max_count));
  check_finite(points, "mesh: points");
  check_coordinates(points, "mesh: points");
}

void check_faces(const Mesh& mesh) {
  if (mesh.face_sizes.size() > max_count) {
    refuse("face_sizes: " + number(mesh.face_sizes.size()) + " faces, the limit is " + number(max_count));
  }
  std::uint64_t corners = 0;
  for (std::size_t i = 0; i < mesh.face_sizes.size(); ++i) {
    if (mesh.face_sizes[i] == 0) refuse("face_sizes[" + number(i) + "]: a face needs at least one corner");
    corners += mesh.face_sizes[i];
  }
  if (corners != mesh.face_points.size()) {
    refuse("face_sizes: they add up to " + number(corners) + " corners, but face_points has " + number(mesh.face_points.size()));
  }
  check_ids(mesh.face_points, mesh.points.size(), "mesh: face_points", "point");
}

void check_groups(const Mesh& mesh) {
  std::unordered_set<std::string> names;
  for (std::size_t i = 0; i < mesh.groups.size(); ++i) {
    const Group& group = mesh.groups[i];
    if (group.name.empty()) refuse("groups[" + number(i) + "]: the name is empty");
    if (!names.insert(group.name).second) refuse("groups[" + number(i) + "]: the name \"" + group.name + "\" is used twice");
    check_ids(group.points, mesh.point_count(), "mesh: group \"" + group.name + "\": points", "point");
    check_ids(group.faces, mesh.face_count(), "mesh: group \"" + group.name + "\": faces", "face");
  }
}

}  // namespace

std::vector<std::uint64_t> Mesh::face_offsets() const {
  std::vector<std::uint64_t> offsets(face_sizes.size() + 1, 0);
  for (std::size_t i = 0; i < face_sizes.size(); ++i) offsets[i + 1] = offsets[i] + face_sizes[i];
  return offsets;
}

const Group* Mesh::find_group(const std::string& name) const {
  for (const Group& group : groups) {
    if (group.name == name) return &group;
  }
  return nullptr;
}

void Mesh::validate() const {
  check_points(points);
  check_faces(*this);
  check_groups(*this);
  if (elements && cells) refuse("cells: given by their nodes and by their faces, only one is allowed");
  if (elements) elements->validate(points.size());
  if (cells) cells->validate(points.size());
}

std::size_t Mesh::cell_count() const { return elements ? elements->size() : cells ? cells->cell_count : 0; }

CellsView Mesh::cells_view() const {
  CellsView view;
  if (elements) {
    static_assert(sizeof(ElementType) == 1);
    view.element_types = {reinterpret_cast<const std::uint8_t*>(elements->types.data()), elements->types.size()};
    view.element_points = elements->points;
  } else if (cells) {
    view.cell_count = cells->cell_count;
    view.face_offsets = cells->face_offsets;
    view.face_points = cells->face_points;
    view.owner = cells->owner;
    view.neighbour = cells->neighbour;
    view.empty_faces = cells->empty_faces;
  }
  return view;
}

}  // namespace deform
