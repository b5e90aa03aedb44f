// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/setup.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "core/base/bounds.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/deformers/methods.h"
#include "core/deformers/option_checks.h"
#include "core/mesh/point_owners.h"
#include "core/mesh/wall_columns.h"

namespace deform {

namespace {

constexpr double most_constraint_weight = 1e10;

bool is_zero(const Vec3& v) { return v[0] == 0 && v[1] == 0 && v[2] == 0; }
Vec3 normalized(const Vec3& v) { return v / norm(v); }

std::string quoted(const std::string& name) { return "\"" + name + "\""; }

// The affine map of one variable at value v and its derivative with respect to v.
Affine translation(const Vec3& d, double v) { return {1, 0, 0, v * d[0], 0, 1, 0, v * d[1], 0, 0, 1, v * d[2]}; }

// A and b = c - A c for the linear map A about the centre c.
Affine about(const std::array<double, 9>& A, const Vec3& c, double keep) {
  Affine m{};
  for (int i = 0; i < 3; ++i) {
    double moved = 0;
    for (int j = 0; j < 3; ++j) {
      m[4 * i + j] = A[3 * i + j];
      moved += A[3 * i + j] * c[j];
    }
    m[4 * i + 3] = keep * c[i] - moved;
  }
  return m;
}

// Rodrigues: cos I + sin [a]x + (1 - cos) a a^T, with the factors given, so that the derivative is the same expression.
std::array<double, 9> rodrigues(const Vec3& a, double identity, double cross, double outer) {
  return {identity + outer * a[0] * a[0],     outer * a[0] * a[1] - cross * a[2], outer * a[0] * a[2] + cross * a[1],
          outer * a[1] * a[0] + cross * a[2], identity + outer * a[1] * a[1],     outer * a[1] * a[2] - cross * a[0],
          outer * a[2] * a[0] - cross * a[1], outer * a[2] * a[1] + cross * a[0], identity + outer * a[2] * a[2]};
}

std::array<double, 9> scaling(const Vec3& axis, double identity, double v) {
  if (is_zero(axis)) return {identity + v, 0, 0, 0, identity + v, 0, 0, 0, identity + v};
  return rodrigues(normalized(axis), identity, 0, v);
}

Affine motion_of(const DesignVariable& variable, double v) {
  if (v == 0) return identity_affine;  // exactly at rest, whatever the centre
  if (const auto* t = std::get_if<DesignVariable::Translate>(&variable.kind)) return translation(t->direction, v);
  if (const auto* r = std::get_if<DesignVariable::Rotate>(&variable.kind)) {
    return about(rodrigues(normalized(r->axis), std::cos(v), std::sin(v), 1 - std::cos(v)), r->centre, 1);
  }
  const auto& s = std::get<DesignVariable::Scale>(variable.kind);
  return about(scaling(s.axis, 1, v), s.centre, 1);
}

Affine derivative_of(const DesignVariable& variable, double v) {
  if (const auto* t = std::get_if<DesignVariable::Translate>(&variable.kind)) {
    return {0, 0, 0, t->direction[0], 0, 0, 0, t->direction[1], 0, 0, 0, t->direction[2]};
  }
  if (const auto* r = std::get_if<DesignVariable::Rotate>(&variable.kind)) {
    return about(rodrigues(normalized(r->axis), -std::sin(v), std::cos(v), std::sin(v)), r->centre, 0);
  }
  const auto& s = std::get<DesignVariable::Scale>(variable.kind);
  return about(scaling(s.axis, 0, 1), s.centre, 0);
}

// compose() for a derivative on either side: the translation column of the inner map is carried by the linear part of the outer
// one, and the outer translation counts only where the inner map is a map (weight 1), not a derivative (weight 0).
Affine chained(const Affine& outer, const Affine& inner, double inner_weight) {
  Affine c{};
  for (int row = 0; row < 3; ++row) {
    for (int col = 0; col < 4; ++col) {
      double sum = col == 3 ? inner_weight * outer[4 * row + 3] : 0.0;
      for (int k = 0; k < 3; ++k) sum += outer[4 * row + k] * inner[4 * k + col];
      c[4 * row + col] = sum;
    }
  }
  return c;
}

std::size_t handle_index(const Setup& setup, const std::string& name) {
  for (std::size_t i = 0; i < setup.handles.size(); ++i) {
    if (setup.handles[i].name == name) return i;
  }
  return setup.handles.size();
}

void validate_variable(const Setup& setup, std::size_t k, std::set<std::string>& names) {
  const DesignVariable& variable = setup.variables[k];
  const std::string field = "variables[" + std::to_string(k) + "]";
  if (variable.name.empty()) refuse_argument(field + ".name: must not be empty");
  if (!names.insert(variable.name).second) refuse_argument(field + ".name: " + quoted(variable.name) + " is used twice");
  const std::string what = "variable " + quoted(variable.name);
  if (handle_index(setup, variable.handle) == setup.handles.size()) {
    std::vector<std::string> candidates;
    for (const auto& handle : setup.handles) candidates.push_back(handle.name);
    const std::string near = nearest_names(variable.handle, candidates);
    refuse_argument(what + ": handle " + quoted(variable.handle) + " does not exist" +
                    (near.empty() ? "" : "; did you mean " + near + "?"));
  }
  const auto check = [&](const Vec3& v, const char* part) {
    if (!is_finite(v)) refuse_argument(what + ": " + part + " must be finite");
  };
  const auto check_nonzero = [&](const Vec3& v, const char* part) {
    check(v, part);
    if (is_zero(v) || !std::isnormal(norm(v))) refuse_argument(what + ": " + part + " must not be zero");
  };
  if (const auto* t = std::get_if<DesignVariable::Translate>(&variable.kind)) {
    check_nonzero(t->direction, "translate");
  } else if (const auto* r = std::get_if<DesignVariable::Rotate>(&variable.kind)) {
    check_nonzero(r->axis, "rotate.axis");
    check(r->centre, "rotate.centre");
  } else {
    const auto& s = std::get<DesignVariable::Scale>(variable.kind);
    check(s.centre, "scale.centre");
    check(s.axis, "scale.axis");
  }
  if (std::isnan(variable.lower) || std::isnan(variable.upper)) refuse_argument(what + ": lower and upper must be numbers");
  if (!(variable.lower <= 0 && variable.upper >= 0)) {
    refuse_argument(what + ": the rest position 0 must lie within lower = " + number_digits(variable.lower) +
                    " and upper = " + number_digits(variable.upper));
  }
}

void check_layers(const ConstraintKind& kind, const Mesh& mesh, const std::string& field) {
  const auto* rigid = std::get_if<Rigid>(&kind);
  if (rigid == nullptr) return;
  check_option_range(rigid->layers, 0, most_wall_layers, field + ".rigid.layers");
  if (rigid->layers > 0 && mesh.cell_count() == 0) {
    refuse_argument(field + ".rigid.layers: the mesh has no cells, only volume meshes have layers of them");
  }
}

void validate_constraints(const Setup& setup, const Mesh& mesh, SelectedRegions& selected) {
  validate_constraint_options(setup.constraint_options);
  std::set<std::string> names;
  for (std::size_t i = 0; i < setup.constraints.size(); ++i) {
    const Constraint& constraint = setup.constraints[i];
    const std::string field = "constraints[" + std::to_string(i) + "]";
    if (constraint.name.empty()) refuse_argument(field + ".name: must not be empty");
    if (!names.insert(constraint.name).second) refuse_argument(field + ".name: " + quoted(constraint.name) + " is used twice");
    check_option_range(constraint.weight, 0, most_constraint_weight, field + ".weight");
    const auto [least, most] = region_counts(constraint.kind);
    if (constraint.regions.size() < least || constraint.regions.size() > most) {
      refuse_argument(field + ".regions: " + std::string(kind_name(constraint.kind)) + " takes " + std::to_string(least) +
                      (most == least ? ""
                       : most > 1000 ? " or more"
                                     : " to " + std::to_string(most)) +
                      " regions, got " + std::to_string(constraint.regions.size()));
    }
    check_layers(constraint.kind, mesh, field);
    auto& ids = selected.constraints.emplace_back();
    for (std::size_t r = 0; r < constraint.regions.size(); ++r) {
      const std::string what = field + ".regions[" + std::to_string(r) + "]";
      ids.push_back(select(constraint.regions[r], mesh, what));
      if (ids.back().empty()) refuse_argument(what + ": " + no_point_text(mesh));
    }
  }
}

/// Refuses points that another handle has, or (of fixed regions) any handle.
void claim(const std::vector<PointId>& ids, std::uint32_t owner, const std::string& what, const Setup& setup,
           PointOwners& owners) {
  const PointOwners::Overlap overlap = owners.claim(ids, owner);
  if (overlap.points != 0) refuse_argument(what + " " + overlap.text("handle " + quoted(setup.handles[overlap.other].name)));
}

/// The values, those beside a bound moved onto it.
std::vector<double> checked_values(const Setup& setup, std::span<const double> variables) {
  if (variables.size() != setup.variables.size()) {
    refuse_argument("variables: expected " + std::to_string(setup.variables.size()) + " values, one per design variable, got " +
                    std::to_string(variables.size()));
  }
  std::vector<double> values;
  for (std::size_t k = 0; k < variables.size(); ++k) {
    const DesignVariable& variable = setup.variables[k];
    const std::string what = "variables[" + std::to_string(k) + "] (" + quoted(variable.name) + ")";
    if (!std::isfinite(variables[k])) refuse_argument(what + ": must be finite");
    const auto value = within_bounds(variables[k], variable.lower, variable.upper);
    if (!value) {
      refuse_argument(what + ": " + number_digits(variables[k]) + " is outside of its bounds [" + number_digits(variable.lower) +
                      ", " + number_digits(variable.upper) + "]");
    }
    values.push_back(*value);
  }
  return values;
}

}  // namespace

void validate_constraint_options(const ConstraintOptions& options) {
  check_option_range(options.tolerance, 1e-12, 1e-2, "constraint_options.tolerance");
  check_option_range(options.iterations, 1, most_constraint_iterations, "constraint_options.iterations");
}

SelectedRegions validate(const Setup& setup, const Mesh& mesh) {
  if (setup.handles.empty()) refuse_argument("handles: at least one is needed");
  std::set<std::string> names;
  for (std::size_t i = 0; i < setup.handles.size(); ++i) {
    const std::string field = "handles[" + std::to_string(i) + "].name";
    if (setup.handles[i].name.empty()) refuse_argument(field + ": must not be empty");
    if (!names.insert(setup.handles[i].name).second)
      refuse_argument(field + ": " + quoted(setup.handles[i].name) + " is used twice");
  }
  std::set<std::string> variable_names;
  for (std::size_t k = 0; k < setup.variables.size(); ++k) validate_variable(setup, k, variable_names);
  validate_method(setup, mesh);

  SelectedRegions selected;
  PointOwners owners(mesh.point_count());
  for (std::size_t i = 0; i < setup.handles.size(); ++i) {
    const std::string what = "handle " + quoted(setup.handles[i].name);
    selected.handles.push_back(select(setup.handles[i].region, mesh, what));
    if (selected.handles.back().empty()) refuse_argument(what + ": " + no_point_text(mesh));
    claim(selected.handles.back(), static_cast<std::uint32_t>(i), what, setup, owners);
  }
  const auto fixed_owner = static_cast<std::uint32_t>(setup.handles.size());
  for (std::size_t i = 0; i < setup.fixed.size(); ++i) {
    const std::string what = "fixed[" + std::to_string(i) + "]";
    const std::vector<PointId> ids = select(setup.fixed[i], mesh, what);
    if (ids.empty()) refuse_argument(what + ": " + no_point_text(mesh));
    claim(ids, fixed_owner, what, setup, owners);
  }
  for (std::size_t id = 0; id < mesh.point_count(); ++id) {
    if (owners.owners()[id] == fixed_owner) selected.fixed.push_back(static_cast<PointId>(id));
  }
  validate_constraints(setup, mesh, selected);
  selected.symmetry = Symmetry(setup.symmetry, mesh);
  return selected;
}

std::vector<Affine> handle_motions(const Setup& setup, std::span<const double> variables) {
  const std::vector<double> values = checked_values(setup, variables);
  std::vector<Affine> motions(setup.handles.size(), identity_affine);
  for (std::size_t k = 0; k < values.size(); ++k) {
    Affine& motion = motions[handle_index(setup, setup.variables[k].handle)];
    motion = compose(motion_of(setup.variables[k], values[k]), motion);
  }
  return motions;
}

std::vector<Affine> handle_motion_derivative(const Setup& setup, std::span<const double> variables, std::size_t k) {
  const std::vector<double> values = checked_values(setup, variables);
  if (k >= setup.variables.size()) {
    refuse_argument("variable " + std::to_string(k) + " is out of range, the setup has " +
                    std::to_string(setup.variables.size()));
  }
  std::vector<Affine> derivatives(setup.handles.size(), Affine{});
  const std::string& handle = setup.variables[k].handle;
  Affine before = identity_affine;
  Affine result{};
  for (std::size_t j = 0; j < values.size(); ++j) {
    const DesignVariable& variable = setup.variables[j];
    if (variable.handle != handle) continue;
    if (j < k) before = compose(motion_of(variable, values[j]), before);
    if (j == k) result = chained(derivative_of(variable, values[j]), before, 1);
    if (j > k) result = chained(motion_of(variable, values[j]), result, 0);
  }
  derivatives[handle_index(setup, handle)] = result;
  return derivatives;
}

}  // namespace deform
