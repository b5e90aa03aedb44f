// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/constraint_sets.h"

#include <utility>

#include "core/mesh/wall_columns.h"

namespace deform {

namespace {

ConstraintSet set_of(const Constraint& constraint, const std::vector<std::vector<PointId>>& regions, const Mesh& mesh,
                     const UnitBox& box, const std::string& what) {
  ConstraintSet set{constraint.name, nullptr, {}, {}, constraint.weight != 0 ? constraint.weight : Constraint::automatic_weight};
  std::vector<std::vector<Vec3>> rest;
  for (const std::vector<PointId>& ids : regions) {
    std::vector<Vec3>& places = rest.emplace_back();
    places.reserve(ids.size());
    for (const PointId id : ids) places.push_back(box.to_unit(mesh.points[id]));
    set.ids.insert(set.ids.end(), ids.begin(), ids.end());
    set.rest.insert(set.rest.end(), places.begin(), places.end());
  }
  set.projection = make_projection(constraint.kind, rest, {box.origin, box.scale}, what);
  return set;
}

/// A set for every column of cells, with its part of the weight.
void add_columns(const Constraint& constraint, const WallColumns& columns, int layers, const Mesh& mesh, const UnitBox& box,
                 const std::string& what, ConstraintSets& result) {
  std::size_t points = 0;
  for (const std::vector<PointId>& column : columns.points) points += column.size();
  for (const std::vector<PointId>& column : columns.points) {
    ConstraintSet& set = result.sets.emplace_back(set_of(constraint, {column}, mesh, box, what));
    set.weight *= static_cast<double>(column.size()) / static_cast<double>(points);
  }
  result.notes.push_back(constraint.name + ": " + std::to_string(columns.points.size()) + " rigid columns of cells, " +
                         std::to_string(columns.shorter) + " of them of fewer than " + std::to_string(layers) + " layers; " +
                         std::to_string(columns.bare) + " faces of the wall without one");
}

}  // namespace

ConstraintSets constraint_sets(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const UnitBox& box) {
  ConstraintSets result;
  for (std::size_t i = 0; i < setup.constraints.size(); ++i) {
    const Constraint& constraint = setup.constraints[i];
    const std::string what = "constraints[" + std::to_string(i) + "]";
    const auto* rigid = std::get_if<Rigid>(&constraint.kind);
    if (rigid == nullptr || rigid->layers == 0) {
      result.sets.push_back(set_of(constraint, regions.constraints[i], mesh, box, what));
    } else {
      const WallColumns columns = wall_columns(mesh, regions.constraints[i][0], rigid->layers, what + ".regions[0]");
      add_columns(constraint, columns, rigid->layers, mesh, box, what, result);
    }
    result.constraint_of.resize(result.sets.size(), i);
  }
  return result;
}

}  // namespace deform
