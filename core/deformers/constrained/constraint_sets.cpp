// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/constraint_sets.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "core/constraints/flat_projection.h"
#include "core/deformers/handles/flat_case.h"
#include "core/mesh/wall_columns.h"

namespace deform {

namespace {

/// Where the points are.
struct Places {
  const Mesh& mesh;
  const UnitBox& box;
  const FlatCase flat{mesh};

  const Vec3* flat_normal() const { return flat.exists() ? &flat.normal() : nullptr; }
};

ConstraintSet set_of(const Constraint& constraint, const std::vector<std::vector<PointId>>& regions, const Places& at,
                     const std::string& what) {
  ConstraintSet set{constraint.name, nullptr, {}, {}, constraint.weight != 0 ? constraint.weight : Constraint::automatic_weight};
  std::vector<std::vector<Vec3>> rest;
  for (const std::vector<PointId>& ids : regions) {
    std::vector<Vec3>& places = rest.emplace_back();
    places.reserve(ids.size());
    for (const PointId id : ids) places.push_back(at.box.to_unit(at.mesh.points[id]));
    set.ids.insert(set.ids.end(), ids.begin(), ids.end());
    set.rest.insert(set.rest.end(), places.begin(), places.end());
  }
  set.projection = make_projection(constraint.kind, rest, {at.box.origin, at.box.scale}, what);
  if (at.flat.exists()) set.projection = std::make_shared<const FlatProjection>(set.projection, at.flat.normal(), set.rest);
  return set;
}

/// The column of a set, whose ids ascend.
std::shared_ptr<const StretchedColumn> stretched(const WallColumns::Stack& stack, const ConstraintSet& set, const Places& at) {
  StretchedColumn::Corners corners{stack.sides, {}};
  for (const PointId id : stack.corners) {
    const auto place = std::lower_bound(set.ids.begin(), set.ids.end(), id) - set.ids.begin();
    corners.places.push_back(static_cast<std::uint32_t>(place));
  }
  return std::make_shared<const StretchedColumn>(std::move(corners), set.rest, at.flat_normal());
}

/// A set for every column of cells, with its part of the weight.
void add_columns(const Constraint& constraint, const WallColumns& columns, int layers, const Places& at, const std::string& what,
                 ConstraintSets& result) {
  std::size_t points = 0;
  for (const std::vector<PointId>& column : columns.points) points += column.size();
  for (std::size_t c = 0; c < columns.points.size(); ++c) {
    const std::vector<PointId>& column = columns.points[c];
    ConstraintSet& set = result.sets.emplace_back(set_of(constraint, {column}, at, what));
    set.weight *= static_cast<double>(column.size()) / static_cast<double>(points);
    set.column = stretched(columns.stacks[c], set, at);
  }
  result.notes.push_back(constraint.name + ": " + std::to_string(columns.points.size()) + " rigid columns of cells, " +
                         std::to_string(columns.shorter) + " of them of fewer than " + std::to_string(layers) + " layers; " +
                         std::to_string(columns.bare) + " faces of the wall without one");
}

void add_constraint(const Constraint& constraint, const std::vector<std::vector<PointId>>& regions, const Places& at,
                    const std::string& what, ConstraintSets& result) {
  const auto* rigid = std::get_if<Rigid>(&constraint.kind);
  if (rigid == nullptr || rigid->layers == 0) {
    result.sets.push_back(set_of(constraint, regions, at, what));
    return;
  }
  const WallColumns columns = wall_columns(at.mesh, regions[0], rigid->layers, what + ".regions[0]");
  add_columns(constraint, columns, rigid->layers, at, what, result);
}

/// Sorts the constraints by content, so that results do not depend on their order in the setup, bit for bit.
std::vector<std::size_t> order_by_content(const Setup& setup, const SelectedRegions& regions) {
  std::vector<std::size_t> order(setup.constraints.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::vector<std::vector<double>> numbers;
  for (const Constraint& constraint : setup.constraints) {
    numbers.push_back(numbers_of(constraint.kind));
    numbers.back().push_back(constraint.weight);
    numbers.back().push_back(constraint.exact ? 1 : 0);
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const std::size_t kind = setup.constraints[a].kind.index(), other = setup.constraints[b].kind.index();
    if (kind != other) return kind < other;
    if (regions.constraints[a] != regions.constraints[b]) return regions.constraints[a] < regions.constraints[b];
    return numbers[a] < numbers[b];
  });
  return order;
}

}  // namespace

ConstraintSets constraint_sets(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const UnitBox& box) {
  ConstraintSets result, written;
  if (setup.constraints.empty()) return result;
  const Places at{mesh, box};
  std::vector<std::size_t> first{0};
  for (std::size_t i = 0; i < setup.constraints.size(); ++i) {
    add_constraint(setup.constraints[i], regions.constraints[i], at, "constraints[" + std::to_string(i) + "]", written);
    first.push_back(written.sets.size());
  }
  result.notes = std::move(written.notes);
  for (const std::size_t i : order_by_content(setup, regions)) {
    for (std::size_t t = first[i]; t < first[i + 1]; ++t) result.sets.push_back(std::move(written.sets[t]));
    result.constraint_of.resize(result.sets.size(), i);
  }
  return result;
}

void check_constraint_sets(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const UnitBox& box,
                           Problems& problems) {
  if (setup.constraints.empty()) return;
  const Places at{mesh, box};
  for (std::size_t i = 0; i < setup.constraints.size(); ++i) {
    const std::string field = "constraints[" + std::to_string(i) + "]";
    if (problems.concern(field)) continue;
    problems.check(field, [&] {
      ConstraintSets ignored;
      add_constraint(setup.constraints[i], regions.constraints[i], at, field, ignored);
    });
  }
}

}  // namespace deform
