// SPDX-License-Identifier: Apache-2.0
#include "client/held_copies.h"

#include <span>
#include <utility>

namespace deform::client {

namespace {

template <typename T>
std::vector<T> copied(std::span<const T> values) {
  return {values.begin(), values.end()};
}

}  // namespace

HeldGeometry::HeldGeometry(const GeometryArrays& arrays)
    : face_sizes_(copied(arrays.face_sizes)),
      face_points_(copied(arrays.face_points)),
      name_(arrays.name),
      element_types_(copied(arrays.cells.element_types)),
      element_points_(copied(arrays.cells.element_points)),
      cell_count_(arrays.cells.cell_count),
      cell_face_offsets_(copied(arrays.cells.face_offsets)),
      cell_face_points_(copied(arrays.cells.face_points)),
      owner_(copied(arrays.cells.owner)),
      neighbour_(copied(arrays.cells.neighbour)),
      empty_faces_(copied(arrays.cells.empty_faces)) {
  for (const auto& group : arrays.groups) {
    groups_.push_back({std::string(group.name), copied(group.points), copied(group.faces)});
  }
}

GeometryArrays HeldGeometry::arrays(const Points& points) const {
  GeometryArrays arrays;
  arrays.points = points;
  arrays.face_sizes = face_sizes_;
  arrays.face_points = face_points_;
  for (const Group& group : groups_) arrays.groups.push_back({group.name, group.points, group.faces});
  arrays.name = name_;
  arrays.cells = {element_types_,    element_points_, cell_count_, cell_face_offsets_,
                  cell_face_points_, owner_,          neighbour_,  empty_faces_};
  return arrays;
}

void HeldCopies::keep_geometry(const std::string& id, std::shared_ptr<const HeldGeometry> geometry) {
  geometries_.keep(id, std::move(geometry));
}

void HeldCopies::keep_setup(const std::string& system, v1::Setup setup) {
  setups_.keep(system, std::make_shared<const v1::Setup>(std::move(setup)));
}

void HeldCopies::keep_all(const HeldCopies& from) {
  geometries_.keep_all(from.geometries_);
  setups_.keep_all(from.setups_);
}

std::shared_ptr<const HeldGeometry> HeldCopies::geometry(const std::string& id) const {
  return geometries_.get(id).value_or(nullptr);
}

std::shared_ptr<const v1::Setup> HeldCopies::setup(const std::string& system) const {
  return setups_.get(system).value_or(nullptr);
}

void HeldCopies::forget_geometry(const std::string& id) {
  geometries_.forget_if([&](const std::string& held, const auto&) { return held.starts_with(id); });
  setups_.forget_if([&](const std::string&, const auto& setup) { return setup->geometry().starts_with(id); });
}

void HeldCopies::forget_setup(const std::string& system) {
  setups_.forget_if([&](const std::string& held, const auto&) { return held.starts_with(system); });
}

}  // namespace deform::client
