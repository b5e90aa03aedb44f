#include "core/deformers/setup.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "core/base/bounds.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/mesh/point_owners.h"
#include "core/mesh/wall_columns.h"

namespace deform {

namespace {

constexpr double most_weight = 1e12;
constexpr double most_samples = 1e6;
constexpr double most_constraint_weight = 1e10;

[[noreturn]] void invalid(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

bool finite(const Vec3& v) { return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]); }
bool is_zero(const Vec3& v) { return v[0] == 0 && v[1] == 0 && v[2] == 0; }
double norm(const Vec3& v) { return std::hypot(v[0], v[1], v[2]); }
Vec3 normalized(const Vec3& v) {
  const double length = norm(v);
  return {v[0] / length, v[1] / length, v[2] / length};
}

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

void validate_rbf(const RbfOptions& options) {
  if (!(options.tolerance >= least_tolerance && options.tolerance <= largest_tolerance)) {
    invalid("method.rbf.tolerance: " + number_digits(options.tolerance) + " is out of range 1e-10..1e-2");
  }
  if (!(options.shape >= 0 && options.shape <= 100)) {
    invalid("method.rbf.shape: " + number_digits(options.shape) + " is out of range, must be 0 (automatic) or up to 100");
  }
  if (options.reduction_rings < 1 || options.reduction_rings > 100) {
    invalid("method.rbf.reduction_rings: " + std::to_string(options.reduction_rings) + " is out of range 1..100");
  }
  if (options.polynomial_degree < -1 || options.polynomial_degree > 2) {
    invalid("method.rbf.polynomial_degree: " + std::to_string(options.polynomial_degree) +
            " is out of range, at least the order of the kernel - 1 and at most 2");
  }
}

void validate_samples(const Setup& setup) {
  const auto* options = std::get_if<RbfOptions>(&setup.method);
  if (options == nullptr) return;
  for (std::size_t s = 0; s < options->samples.size(); ++s) {
    const std::string field = "method.rbf.samples[" + std::to_string(s) + "]";
    try {
      handle_motions(setup, options->samples[s]);
    } catch (const Error& error) {
      invalid(field + "." + error.what());
    }
    const auto& values = options->samples[s];
    if (std::all_of(values.begin(), values.end(), [](double value) { return value == 0; })) {
      invalid(field + ": moves nothing; all its variables are 0");
    }
  }
}

void check_range(double value, double least, double most, const std::string& field) {
  if (value >= least && value <= most) return;
  invalid(field + ": " + number_digits(value) + " is out of range " + number_digits(least) + ".." + number_digits(most));
}

void check_weights(double stretching, double bending, const std::string& field) {
  check_range(stretching, 0, most_weight, field + ".stretching");
  check_range(bending, 0, most_weight, field + ".bending");
  if (stretching == 0 && bending == 0) invalid(field + ": stretching and bending must not both be 0");
}

template <typename Options>
void check_energy(const Options& options, const std::string& field, const Setup& setup) {
  check_weights(options.stretching, options.bending, field);
  if (!(options.fixing > 0 && options.fixing <= most_weight)) {
    invalid(field + ".fixing: " + number_digits(options.fixing) + " is out of range, must be over 0 and up to " +
            number_digits(most_weight));
  }
  if (!setup.symmetry.empty()) {
    invalid("symmetry: " + field + " does not take symmetry planes, only method.rbf does; deform the whole model");
  }
}

void validate_subspace(const SubspaceOptions& options) {
  check_range(static_cast<double>(options.centres), 4, 100000, "method.subspace.centres");
  check_range(options.cover, 4, 1000, "method.subspace.cover");
  if (!options.kernel) return;
  const KernelProperties kernel = properties(*options.kernel);
  if (kernel.has_shape && kernel.local_shape == 0) {
    invalid(std::string("method.subspace.kernel: ") + kernel.name + " has a shape but does not decay");
  }
}

void validate_mls(const MlsOptions& options, const Mesh& mesh) {
  check_range(static_cast<double>(options.surface_samples), 0, most_samples, "method.mls.surface_samples");
  check_range(static_cast<double>(options.volume_samples), 0, most_samples, "method.mls.volume_samples");
  check_range(options.cubature, 1, 64, "method.mls.cubature");
  check_range(options.cover, 5, 1000, "method.mls.cover");
  for (std::size_t i = 0; i < options.weights.size(); ++i) {
    const std::string field = "method.mls.weights[" + std::to_string(i) + "]";
    check_weights(options.weights[i].stretching, options.weights[i].bending, field);
    if (select(options.weights[i].region, mesh, field).empty()) invalid(field + ": " + no_point_text(mesh));
  }
}

void validate_method(const Setup& setup, const Mesh& mesh) {
  if (const auto* rbf = std::get_if<RbfOptions>(&setup.method)) {
    validate_rbf(*rbf);
  } else if (const auto* shell = std::get_if<ShellOptions>(&setup.method)) {
    check_energy(*shell, "method.shell", setup);
  } else if (const auto* subspace = std::get_if<SubspaceOptions>(&setup.method)) {
    check_energy(*subspace, "method.subspace", setup);
    validate_subspace(*subspace);
  } else {
    const auto& mls = std::get<MlsOptions>(setup.method);
    check_energy(mls, "method.mls", setup);
    validate_mls(mls, mesh);
  }
}

void validate_variable(const Setup& setup, std::size_t k, std::set<std::string>& names) {
  const DesignVariable& variable = setup.variables[k];
  const std::string field = "variables[" + std::to_string(k) + "]";
  if (variable.name.empty()) invalid(field + ".name: must not be empty");
  if (!names.insert(variable.name).second) invalid(field + ".name: " + quoted(variable.name) + " is used twice");
  const std::string what = "variable " + quoted(variable.name);
  if (handle_index(setup, variable.handle) == setup.handles.size()) {
    std::vector<std::string> candidates;
    for (const auto& handle : setup.handles) candidates.push_back(handle.name);
    const std::string near = nearest_names(variable.handle, candidates);
    invalid(what + ": handle " + quoted(variable.handle) + " does not exist" +
            (near.empty() ? "" : "; did you mean " + near + "?"));
  }
  const auto check = [&](const Vec3& v, const char* part) {
    if (!finite(v)) invalid(what + ": " + part + " must be finite");
  };
  const auto check_nonzero = [&](const Vec3& v, const char* part) {
    check(v, part);
    if (is_zero(v) || !std::isnormal(norm(v))) invalid(what + ": " + part + " must not be zero");
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
  if (std::isnan(variable.lower) || std::isnan(variable.upper)) invalid(what + ": lower and upper must be numbers");
  if (!(variable.lower <= 0 && variable.upper >= 0)) {
    invalid(what + ": the rest position 0 must lie within lower = " + number_digits(variable.lower) +
            " and upper = " + number_digits(variable.upper));
  }
}

void check_layers(const ConstraintKind& kind, const Mesh& mesh, const std::string& field) {
  const auto* rigid = std::get_if<Rigid>(&kind);
  if (rigid == nullptr) return;
  check_range(rigid->layers, 0, most_wall_layers, field + ".rigid.layers");
  if (rigid->layers > 0 && mesh.cell_count() == 0) {
    invalid(field + ".rigid.layers: the mesh has no cells, only volume meshes have layers of them");
  }
}

void validate_constraints(const Setup& setup, const Mesh& mesh, SelectedRegions& selected) {
  validate_constraint_options(setup.constraint_options);
  if (!setup.constraints.empty() && std::holds_alternative<RbfOptions>(setup.method)) {
    invalid("constraints: method.rbf does not take geometric constraints; use method shell, subspace or mls");
  }
  std::set<std::string> names;
  for (std::size_t i = 0; i < setup.constraints.size(); ++i) {
    const Constraint& constraint = setup.constraints[i];
    const std::string field = "constraints[" + std::to_string(i) + "]";
    if (constraint.name.empty()) invalid(field + ".name: must not be empty");
    if (!names.insert(constraint.name).second) invalid(field + ".name: " + quoted(constraint.name) + " is used twice");
    check_range(constraint.weight, 0, most_constraint_weight, field + ".weight");
    const auto [least, most] = region_counts(constraint.kind);
    if (constraint.regions.size() < least || constraint.regions.size() > most) {
      invalid(field + ".regions: " + std::string(kind_name(constraint.kind)) + " takes " + std::to_string(least) +
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
      if (ids.back().empty()) invalid(what + ": " + no_point_text(mesh));
    }
  }
}

/// Refuses points that another handle has, or (of fixed regions) any handle.
void claim(const std::vector<PointId>& ids, std::uint32_t owner, const std::string& what, const Setup& setup,
           PointOwners& owners) {
  const PointOwners::Overlap overlap = owners.claim(ids, owner);
  if (overlap.points != 0) invalid(what + " " + overlap.text("handle " + quoted(setup.handles[overlap.other].name)));
}

/// The values, those beside a bound moved onto it.
std::vector<double> checked_values(const Setup& setup, std::span<const double> variables) {
  if (variables.size() != setup.variables.size()) {
    invalid("variables: expected " + std::to_string(setup.variables.size()) + " values, one per design variable, got " +
            std::to_string(variables.size()));
  }
  std::vector<double> values;
  for (std::size_t k = 0; k < variables.size(); ++k) {
    const DesignVariable& variable = setup.variables[k];
    const std::string what = "variables[" + std::to_string(k) + "] (" + quoted(variable.name) + ")";
    if (!std::isfinite(variables[k])) invalid(what + ": must be finite");
    const auto value = within_bounds(variables[k], variable.lower, variable.upper);
    if (!value) {
      invalid(what + ": " + number_digits(variables[k]) + " is outside of its bounds [" + number_digits(variable.lower) + ", " +
              number_digits(variable.upper) + "]");
    }
    values.push_back(*value);
  }
  return values;
}

}  // namespace

void validate_constraint_options(const ConstraintOptions& options) {
  check_range(options.tolerance, 1e-12, 1e-2, "constraint_options.tolerance");
  check_range(options.iterations, 1, most_constraint_iterations, "constraint_options.iterations");
}

SelectedRegions validate(const Setup& setup, const Mesh& mesh) {
  validate_method(setup, mesh);
  if (setup.handles.empty()) invalid("handles: at least one is needed");
  std::set<std::string> names;
  for (std::size_t i = 0; i < setup.handles.size(); ++i) {
    const std::string field = "handles[" + std::to_string(i) + "].name";
    if (setup.handles[i].name.empty()) invalid(field + ": must not be empty");
    if (!names.insert(setup.handles[i].name).second) invalid(field + ": " + quoted(setup.handles[i].name) + " is used twice");
  }
  std::set<std::string> variable_names;
  for (std::size_t k = 0; k < setup.variables.size(); ++k) validate_variable(setup, k, variable_names);
  validate_samples(setup);

  SelectedRegions selected;
  PointOwners owners(mesh.point_count());
  for (std::size_t i = 0; i < setup.handles.size(); ++i) {
    const std::string what = "handle " + quoted(setup.handles[i].name);
    selected.handles.push_back(select(setup.handles[i].region, mesh, what));
    if (selected.handles.back().empty()) invalid(what + ": " + no_point_text(mesh));
    claim(selected.handles.back(), static_cast<std::uint32_t>(i), what, setup, owners);
  }
  const auto fixed_owner = static_cast<std::uint32_t>(setup.handles.size());
  for (std::size_t i = 0; i < setup.fixed.size(); ++i) {
    const std::string what = "fixed[" + std::to_string(i) + "]";
    const std::vector<PointId> ids = select(setup.fixed[i], mesh, what);
    if (ids.empty()) invalid(what + ": " + no_point_text(mesh));
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
    invalid("variable " + std::to_string(k) + " is out of range, the setup has " + std::to_string(setup.variables.size()));
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
