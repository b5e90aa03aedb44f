// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/setup.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <type_traits>
#include <variant>

#include "core/base/bounds.h"
#include "core/base/direction.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/compiled/motion.h"
#include "core/deformers/composed/composed_setup.h"
#include "core/deformers/methods.h"
#include "core/deformers/option_checks.h"
#include "core/mesh/point_owners.h"
#include "core/mesh/wall_columns.h"

namespace deform {

Setup::Setup() = default;
Setup::Setup(const Setup& other) = default;
Setup::Setup(Setup&& other) noexcept = default;
Setup& Setup::operator=(const Setup& other) = default;
Setup& Setup::operator=(Setup&& other) noexcept = default;
Setup::~Setup() = default;

double default_reduction_tolerance(Kernel kernel) { return properties(kernel).reduction_tolerance; }

std::vector<std::vector<double>>* samples_of(MethodOptions& method) {
  return std::visit(
      []([[maybe_unused]] auto& options) -> std::vector<std::vector<double>>* {
        if constexpr (requires { options.samples; }) return &options.samples;
        return nullptr;
      },
      method);
}

double default_cover(const std::optional<Kernel>& kernel) { return kernel && properties(*kernel).local_shape > 0 ? 50 : 8; }

namespace {

constexpr double most_constraint_weight = 1e10;

std::string quoted(const std::string& name) { return "\"" + name + "\""; }

std::size_t handle_index(const Setup& setup, const std::string& name) {
  for (std::size_t i = 0; i < setup.handles.size(); ++i) {
    if (setup.handles[i].name == name) return i;
  }
  return setup.handles.size();
}

/// "roof_2", or with the next number that is free.
std::string free_name(const std::string& name, const std::set<std::string>& names) {
  for (std::size_t number = 2;; ++number) {
    std::string other = name + "_" + std::to_string(number);
    if (!names.contains(other)) return other;
  }
}

/// The names of handles, variables or constraints.
struct Names {
  template <typename Named>
  explicit Names(const std::vector<Named>& named) {
    for (const Named& one : named) all.insert(one.name);
  }
  std::set<std::string> all, checked;
};

void check_name(const std::string& name, const std::string& field, Names& names) {
  if (name.empty()) refuse_argument(field + ": must not be empty");
  if (!names.checked.insert(name).second)
    refuse_argument(field + ": " + quoted(name) + " is used twice; give each its own name, for instance " +
                    quoted(free_name(name, names.all)));
}

void check_handle(const Setup& setup, const std::string& name, const std::string& what) {
  if (handle_index(setup, name) < setup.handles.size()) return;
  std::vector<std::string> candidates;
  for (const auto& handle : setup.handles) candidates.push_back(handle.name);
  const std::string near = nearest_names(name, candidates);
  refuse_argument(what + ": handle " + quoted(name) + " does not exist" + (near.empty() ? "" : "; did you mean " + near + "?"));
}

void check_motion(const VariableMotion& motion, const std::string& what) {
  const auto check = [&](const Vec3& v, const char* part) {
    if (!is_finite(v)) refuse_argument(what + ": " + part + " must be finite");
  };
  const auto check_direction = [&](const Vec3& v, const char* part) {
    if (const char* problem = direction_problem(v)) refuse_argument(what + ": " + part + " " + problem);
  };
  if (const auto* t = std::get_if<DesignVariable::Translate>(&motion)) {
    check_direction(t->direction, "translate");
  } else if (const auto* r = std::get_if<DesignVariable::Rotate>(&motion)) {
    check_direction(r->axis, "rotate.axis");
    check(r->centre, "rotate.centre");
  } else {
    const auto& s = std::get<DesignVariable::Scale>(motion);
    check(s.centre, "scale.centre");
    if (s.axis != Vec3{}) check_direction(s.axis, "scale.axis");
  }
}

void validate_variable(const Setup& setup, std::size_t k, Names& names) {
  const DesignVariable& variable = setup.variables[k];
  const std::string field = "variables[" + std::to_string(k) + "]";
  check_name(variable.name, field + ".name", names);
  const std::string what = "variable " + quoted(variable.name);
  std::set<std::string> moved{variable.handle};
  check_handle(setup, variable.handle, what);
  check_motion(variable.kind, what);
  for (std::size_t i = 0; i < variable.also.size(); ++i) {
    const std::string entry = what + ": also[" + std::to_string(i) + "]";
    check_handle(setup, variable.also[i].handle, entry);
    if (!moved.insert(variable.also[i].handle).second) {
      refuse_argument(entry + ": handle " + quoted(variable.also[i].handle) + " is moved by this variable already");
    }
    check_motion(variable.also[i].kind, entry);
  }
  if (std::isnan(variable.lower) || std::isnan(variable.upper)) refuse_argument(what + ": lower and upper must be numbers");
  if (variable.lower > variable.upper) {
    refuse_argument(what + ": lower = " + number_digits(variable.lower) + " is above upper = " + number_digits(variable.upper));
  }
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

std::string indexed(const char* list, std::size_t index) { return std::string(list) + "[" + std::to_string(index) + "]"; }

void claim(std::size_t bytes, const std::string& what, const RunContext& context) {
  try {
    context.claim(bytes);
  } catch (const Error& error) {
    throw Error(error.code(), what + ": " + error.what(), error.retry_after_ms());
  }
}

/// select(), and it must not be empty.
std::vector<PointId> selected_points(const Region& region, const Mesh& mesh, const std::string& what, const RunContext& context) {
  std::vector<PointId> ids = select(region, mesh, what, context);
  if (ids.empty()) refuse_argument(what + ": " + no_point_text(mesh));
  claim(ids.size() * sizeof(PointId), what, context);
  return ids;
}

/// Whether a region selects control points, at any depth.
bool names_controls(const Region& region) {
  return std::visit(
      [](const auto& kind) {
        using Kind = std::decay_t<decltype(kind)>;
        if constexpr (std::is_same_v<Kind, Region::LatticeRange> || std::is_same_v<Kind, Region::ControlIds>) return true;
        if constexpr (requires { kind.of; }) return std::any_of(kind.of.begin(), kind.of.end(), names_controls);
        return false;
      },
      region.kind);
}

/// Selects what handles and fixed regions hold: points of the mesh, or control points.
class HeldRegions {
 public:
  /// Control points of a method that has problems are not known: then none are selected.
  HeldRegions(const Setup& setup, const Mesh& mesh, const Problems& problems, const RunContext& context)
      : mesh_(mesh), context_(context), method_known_(!problems.concern("method")) {
    if (!selects_controls(setup)) return;
    of_ = SelectedRegions::Of::control_points;
    if (!method_known_) return;
    try {
      controls_ = controls_of(setup, mesh, Symmetry(setup.symmetry, mesh));
    } catch (const Error& error) {
      if (error.code() != ErrorCode::invalid_argument) throw;
      method_known_ = false;  // planes that are wrong are refused later
    }
  }

  SelectedRegions::Of of() const { return of_; }
  /// Whether it is known what the region selects.
  bool known(const Region& region) const {
    return method_known_ || (of_ == SelectedRegions::Of::mesh_points && !names_controls(region));
  }
  std::size_t size() const { return of_ == SelectedRegions::Of::mesh_points ? mesh_.point_count() : controls_.size; }
  std::vector<PointId> select(const Region& region, const std::string& what) const {
    if (of_ == SelectedRegions::Of::mesh_points) return selected_points(region, mesh_, what, context_);
    std::vector<PointId> ids = select_controls(region, controls_, what, context_);
    if (ids.empty()) refuse_argument(what + ": its region contains no control point");
    return ids;
  }

 private:
  const Mesh& mesh_;
  const RunContext& context_;
  SelectedRegions::Of of_ = SelectedRegions::Of::mesh_points;
  bool method_known_;
  ControlSet controls_;
};

/// Bytes of a point in a set of constraints, which estimates build: its id, its rest position and its part of a projection.
constexpr std::size_t set_bytes_per_point = sizeof(PointId) + sizeof(Vec3) + 64;

/// All but its regions.
void check_constraint(const Constraint& constraint, const Mesh& mesh, const std::string& field) {
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
}

void validate_constraints(const Setup& setup, const Mesh& mesh, SelectedRegions& selected, Problems& problems,
                          const RunContext& context) {
  problems.check("constraint_options", [&] { validate_constraint_options(setup.constraint_options); });
  Names names(setup.constraints);
  for (std::size_t i = 0; i < setup.constraints.size(); ++i) {
    const Constraint& constraint = setup.constraints[i];
    const std::string field = indexed("constraints", i);
    auto& ids = selected.constraints.emplace_back(constraint.regions.size());
    if (problems.concern(field)) continue;
    problems.check(field + ".name", [&] { check_name(constraint.name, field + ".name", names); });
    problems.check(field, [&] { check_constraint(constraint, mesh, field); });
    for (std::size_t r = 0; r < constraint.regions.size(); ++r) {
      const std::string what = field + indexed(".regions", r);
      if (problems.concern(what)) continue;
      problems.check(what, [&] {
        ids[r] = selected_points(constraint.regions[r], mesh, what, context);
        claim(ids[r].size() * set_bytes_per_point, what, context);
      });
    }
  }
}

/// Refuses points that another handle has, or (of fixed regions) any handle.
void claim(const std::vector<PointId>& ids, std::uint32_t owner, const std::string& what, const Setup& setup,
           PointOwners& owners) {
  const PointOwners::Overlap overlap = owners.claim(ids, owner);
  if (overlap.points == 0) return;
  refuse_argument(
      what + " " +
      overlap.text("handle " + quoted(setup.handles[overlap.other].name), selects_controls(setup) ? "control point" : "point"));
}

/// What holds a point of a periodic boundary holds its partner as well, possibly another handle.
void check_partners(const Setup& setup, const Sector& sector, const PointOwners& owners) {
  const auto nobodys = static_cast<std::uint32_t>(setup.handles.size()) + 1;
  const auto is_free = [&](PointId id) { return owners.owners()[id] >= nobodys; };
  for (const Sector::Pair& pair : sector.pairs()) {
    if (is_free(pair.first) == is_free(pair.second)) continue;
    const PointId held = is_free(pair.first) ? pair.second : pair.first, follows = is_free(pair.first) ? pair.first : pair.second;
    const std::uint32_t owner = owners.owners()[held];
    refuse_argument("symmetry[0].sector: point " + std::to_string(held) + " is in " +
                    (owner + 1 == nobodys ? "a fixed region" : "handle " + quoted(setup.handles[owner].name)) +
                    ", but its partner on the other periodic boundary, point " + std::to_string(follows) +
                    ", is in none; take both into regions, or both out of them with `difference`");
  }
}

/// How a variable moves a handle; null when it does not.
const VariableMotion* motion_on(const DesignVariable& variable, const std::string& handle) {
  if (variable.handle == handle) return &variable.kind;
  for (const DrivenHandle& driven : variable.also) {
    if (driven.handle == handle) return &driven.kind;
  }
  return nullptr;
}

/// The derivative of the motion of a handle with respect to variable k, which moves it.
Affine derivative_on(const Setup& setup, const std::vector<double>& values, std::size_t k, const std::string& handle) {
  Affine before = identity_affine;
  Affine result{};
  for (std::size_t j = 0; j < values.size(); ++j) {
    const VariableMotion* motion = motion_on(setup.variables[j], handle);
    if (motion == nullptr) continue;
    if (j < k) before = compose(motion_at(*motion, values[j]), before);
    if (j == k) result = compiled::chained(motion_rate(*motion, values[j]), before, 1);
    if (j > k) result = compiled::chained(motion_at(*motion, values[j]), result, 0);
  }
  return result;
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
    const auto usable = [&](const VariableMotion& kind) {
      const std::string problem = compiled::unusable_value(compiled_motion(kind), *value);
      if (!problem.empty()) refuse_argument(what + ": " + number_digits(*value) + " " + problem);
    };
    usable(variable.kind);
    for (const DrivenHandle& driven : variable.also) usable(driven.kind);
    values.push_back(*value);
  }
  return values;
}

/// Refuses motions that no double can hold.
void check_motions(const Setup& setup, std::span<const Affine> motions) {
  for (std::size_t h = 0; h < motions.size(); ++h) {
    if (std::all_of(motions[h].begin(), motions[h].end(), [](double entry) { return std::isfinite(entry); })) continue;
    refuse_argument("variables: they move handle " + quoted(setup.handles[h].name) + " farther than a number can say");
  }
}

}  // namespace

void validate_constraint_options(const ConstraintOptions& options) {
  check_option_range(options.tolerance, 1e-12, 1e-2, "constraint_options.tolerance");
  check_option_range(options.iterations, 1, most_constraint_iterations, "constraint_options.iterations");
}

SelectedRegions validate(const Setup& setup, const Mesh& mesh, const RunContext& context) {
  Problems problems(Problems::Mode::throw_first);
  return validate(setup, mesh, problems, context);
}

SelectedRegions validate(const Setup& setup, const Mesh& mesh, Problems& problems, const RunContext& context) {
  problems.check("handles", [&] {
    if (setup.handles.empty()) refuse_argument("handles: at least one is needed");
  });
  Names names(setup.handles), variable_names(setup.variables);
  for (std::size_t i = 0; i < setup.handles.size(); ++i) {
    const std::string field = indexed("handles", i) + ".name";
    if (problems.concern(field)) continue;
    problems.check(field, [&] { check_name(setup.handles[i].name, field, names); });
  }
  for (std::size_t k = 0; k < setup.variables.size(); ++k) {
    const std::string field = indexed("variables", k);
    if (problems.concern(field)) continue;
    problems.check(field, [&] { validate_variable(setup, k, variable_names); });
  }
  if (is_composed(setup)) return validate_stages(setup, mesh, problems, context);
  if (!problems.contain("method")) validate_method(setup, mesh, problems);

  SelectedRegions selected;
  const HeldRegions held(setup, mesh, problems, context);
  selected.of = held.of();
  PointOwners owners(held.size());
  for (std::size_t i = 0; i < setup.handles.size(); ++i) {
    const std::string field = indexed("handles", i) + ".region";
    auto& ids = selected.handles.emplace_back();
    if (problems.concern(field) || !held.known(setup.handles[i].region)) continue;
    problems.check(field, [&] {
      const std::string what = "handle " + quoted(setup.handles[i].name);
      ids = held.select(setup.handles[i].region, what);
      claim(ids, static_cast<std::uint32_t>(i), what, setup, owners);
    });
  }
  const auto fixed_owner = static_cast<std::uint32_t>(setup.handles.size());
  for (std::size_t i = 0; i < setup.fixed.size(); ++i) {
    const std::string what = indexed("fixed", i);
    if (problems.concern(what) || !held.known(setup.fixed[i])) continue;
    problems.check(what, [&] { claim(held.select(setup.fixed[i], what), fixed_owner, what, setup, owners); });
  }
  for (std::size_t id = 0; id < held.size(); ++id) {
    if (owners.owners()[id] == fixed_owner) selected.fixed.push_back(static_cast<PointId>(id));
  }
  validate_constraints(setup, mesh, selected, problems, context);
  if (!problems.concern("symmetry")) {
    problems.check("symmetry", [&] {
      selected.symmetry = Symmetry(setup.symmetry, mesh);
      if (selected.of == SelectedRegions::Of::mesh_points) check_partners(setup, selected.symmetry.sector(), owners);
    });
  }
  return selected;
}

std::vector<Affine> handle_motions(const Setup& setup, std::span<const double> variables) {
  const std::vector<double> values = checked_values(setup, variables);
  std::vector<Affine> motions(setup.handles.size(), identity_affine);
  for (std::size_t k = 0; k < values.size(); ++k) {
    const auto move = [&](const std::string& handle, const VariableMotion& kind) {
      Affine& motion = motions[handle_index(setup, handle)];
      motion = compose(motion_at(kind, values[k]), motion);
    };
    move(setup.variables[k].handle, setup.variables[k].kind);
    for (const DrivenHandle& driven : setup.variables[k].also) move(driven.handle, driven.kind);
  }
  check_motions(setup, motions);
  return motions;
}

std::vector<Affine> handle_motion_derivative(const Setup& setup, std::span<const double> variables, std::size_t k) {
  const std::vector<double> values = checked_values(setup, variables);
  if (k >= setup.variables.size()) {
    refuse_argument("variable " + std::to_string(k) + " is out of range, the setup has " +
                    std::to_string(setup.variables.size()));
  }
  std::vector<Affine> derivatives(setup.handles.size(), Affine{});
  const auto derive = [&](const std::string& handle) {
    derivatives[handle_index(setup, handle)] = derivative_on(setup, values, k, handle);
  };
  derive(setup.variables[k].handle);
  for (const DrivenHandle& driven : setup.variables[k].also) derive(driven.handle);
  return derivatives;
}

}  // namespace deform
