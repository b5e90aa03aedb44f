// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/setup_hints.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <utility>
#include <variant>

#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/mesh/region.h"

namespace deform {

namespace {

constexpr double small_reach = 1e-4, large_reach = 1;  // of D
constexpr std::size_t most_variables = 100;

double radians(const Rotation& rotation, double value) {
  return rotation.unit == AngleUnit::degrees ? value * std::numbers::pi / 180 : value;
}

/// The distance on which the displacement of a point depends: from the axis or the centre, or along the axis.
double arm(const VariableMotion& kind, const Vec3& point) {
  if (const auto* rotation = std::get_if<Rotation>(&kind)) {
    return norm(cross(rotation->axis, point - rotation->centre)) / norm(rotation->axis);
  }
  const auto* scaling = std::get_if<Scaling>(&kind);
  if (scaling == nullptr) return 0;
  const double length = norm(scaling->axis);
  return length > 0 ? std::abs(dot(scaling->axis, point - scaling->centre)) / length : norm(point - scaling->centre);
}

/// How far a point with this arm goes at most between 0 and the value.
double way(const VariableMotion& kind, double arm, double value) {
  if (const auto* translation = std::get_if<Translation>(&kind)) return std::abs(value) * norm(translation->direction);
  const auto* rotation = std::get_if<Rotation>(&kind);
  if (rotation == nullptr) return std::abs(value) * arm;
  return 2 * arm * std::sin(std::min(std::abs(radians(*rotation, value)), std::numbers::pi) / 2);
}

bool selects_points(const SelectedRegions& regions) {
  const auto of_mesh = [](const SelectedRegions& one) { return one.of == SelectedRegions::Of::mesh_points; };
  return of_mesh(regions) && std::all_of(regions.stages.begin(), regions.stages.end(), of_mesh);
}

/// Calls visit(handle, kind) for all handles that a variable moves.
template <typename Visit>
void for_each_motion(const DesignVariable& variable, const Visit& visit) {
  visit(variable.handle, variable.kind);
  for (const DrivenHandle& driven : variable.also) visit(driven.handle, driven.kind);
}

/// What is rarely meant of one motion; empty if nothing is.
std::string motion_note(const DesignVariable& variable, const std::string& handle, const VariableMotion& kind) {
  const double largest = std::max(-variable.lower, variable.upper);
  if (const auto* rotation = std::get_if<Rotation>(&kind)) {
    const double turns = radians(*rotation, largest) / (2 * std::numbers::pi);
    const bool degrees = rotation->unit == AngleUnit::degrees;
    if (!std::isfinite(turns) || turns <= (degrees ? 1 : 0.5)) return {};
    return " They turn handle \"" + handle + "\" by up to " + three_digits(largest) + (degrees ? " degrees, " : " radians, ") +
           three_digits(turns) + " turns" + (degrees ? "." : "; for degrees give the rotation unit: DEGREES.");
  }
  if (!std::holds_alternative<Scaling>(kind) || !std::isfinite(variable.lower) || variable.lower > -1) return {};
  return " At " + number_digits(variable.lower) + " they " + (variable.lower < -1 ? "mirror" : "flatten") + " handle \"" +
         handle + "\": a scale of v multiplies by 1 + v, -0.1 is 10 % less.";
}

}  // namespace

std::vector<std::optional<double>> variable_reaches(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                                                    const RunContext& context) {
  std::vector<std::optional<double>> reaches;
  const bool known = selects_points(regions);
  for (const DesignVariable& variable : setup.variables) {
    auto& reach = reaches.emplace_back();
    if (!known || !std::isfinite(variable.lower) || !std::isfinite(variable.upper)) continue;
    context.check();
    reach = 0;
    for_each_motion(variable, [&](const std::string& name, const VariableMotion& kind) {
      const auto handle =
          std::find_if(setup.handles.begin(), setup.handles.end(), [&](const Handle& h) { return h.name == name; });
      double longest = 0;
      if (!std::holds_alternative<Translation>(kind)) {
        for (const PointId id : regions.handles[static_cast<std::size_t>(handle - setup.handles.begin())]) {
          longest = std::max(longest, arm(kind, mesh.points[id]));
        }
      }
      reach = std::max({*reach, way(kind, longest, variable.lower), way(kind, longest, variable.upper)});
    });
  }
  return reaches;
}

std::vector<std::string> variable_notes(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                                        const RunContext& context) {
  const std::vector<std::optional<double>> reaches = variable_reaches(mesh, setup, regions, context);
  const double diagonal = bounding_box(mesh.points).diagonal();
  std::vector<std::string> notes;
  for (std::size_t k = 0; k < reaches.size(); ++k) {
    const DesignVariable& variable = setup.variables[k];
    std::string note;
    if (reaches[k]) {
      const double share = diagonal > 0 ? *reaches[k] / diagonal : 0;
      note = " bounds move points by up to " + three_digits(*reaches[k]) + " (" + three_digits(share) + " D).";
      if (share < small_reach) note += " That is hardly anything; are they in the units of the mesh?";
      if (share > large_reach) note += " That is farther than the model is long; are they in the units of the mesh?";
    }
    for_each_motion(variable, [&](const std::string& handle, const VariableMotion& kind) {
      const std::string more = motion_note(variable, handle, kind);
      if (!more.empty() && note.empty()) note = " see the bounds.";
      note += more;
    });
    if (note.empty()) continue;
    if (notes.size() == most_variables) {
      notes.push_back("Notes on bounds are about the first " + std::to_string(most_variables) + " variables only.");
      break;
    }
    notes.push_back("Variable " + variable.name + ":" + note);
  }
  return notes;
}

std::string half_model_note(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions) {
  if (!setup.symmetry.empty() || mesh.cell_count() > 0 || mesh.face_count() == 0 || !selects_points(regions)) return {};
  const std::vector<PointId> rim = select({Region::OpenBoundary{}}, mesh, "open boundary");
  const Box box = bounding_box(mesh.points);
  const double limit = 1e-6 * box.diagonal();
  std::array<bool, 6> holds{true, true, true, true, true, true};  // the sides: least and greatest x, y, z
  bool free = false;
  for (const PointId id : rim) {
    for (int side = 0; side < 6; ++side) {
      const double at = side % 2 == 0 ? box.min[side / 2] : box.max[side / 2];
      if (!(std::abs(mesh.points[id][side / 2] - at) <= limit)) holds[static_cast<std::size_t>(side)] = false;
    }
    free = free || !std::binary_search(regions.fixed.begin(), regions.fixed.end(), id);
  }
  if (!free) return {};
  for (int side = 0; side < 6; ++side) {
    if (!holds[static_cast<std::size_t>(side)] || box.side(side / 2) <= limit) continue;
    const double at = side % 2 == 0 ? box.min[side / 2] : box.max[side / 2];
    const std::string axis(1, "xyz"[side / 2]);
    return "The surface is open at " + axis + " = " + number_digits(at) +
           " only: if it is half of a model, its rim leaves this plane unless `symmetry` gives it.";
  }
  return {};
}

}  // namespace deform
