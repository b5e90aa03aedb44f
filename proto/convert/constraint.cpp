// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/constraint.h"

#include <algorithm>

#include "core/deformers/setup.h"
#include "proto/convert/base/fields.h"
#include "proto/convert/mesh/region.h"
#include "proto/convert/method_traits.h"

namespace deform::convert {

namespace {

Size size_of(v1::Size size, const std::string& path) { return known(size, path) == v1::KEPT ? Size::kept : Size::free; }

Bound bound_of(v1::Bound bound, Bound otherwise, const std::string& path) {
  if (known(bound, path) == v1::BOUND_DEFAULT) return otherwise;
  return bound == v1::EQUAL ? Bound::equal : bound == v1::MINIMUM ? Bound::minimum : Bound::maximum;
}

Symmetric symmetric(const v1::Constraint::Symmetric& message, const std::string& path) {
  Symmetric result;
  if (message.point().empty() != message.normal().empty()) refuse_field(path, "point and normal come together");
  if (!message.point().empty()) {
    result.plane = Symmetric::Plane{vec3(message.point(), path + ".point"), vec3(message.normal(), path + ".normal")};
  }
  if (message.tolerance() != 0) result.tolerance = finite(message.tolerance(), path + ".tolerance");
  return result;
}

Distance distance(const v1::Constraint::Distance& message, const std::string& path) {
  Distance result;
  result.bound = bound_of(message.bound(), Bound::equal, path + ".bound");
  if (message.has_value()) result.value = finite(message.value(), path + ".value");
  return result;
}

Extent extent(const v1::Constraint::Extent& message, const std::string& path) {
  Extent result;
  result.axis = vec3(message.axis(), path + ".axis");
  result.bound = bound_of(message.bound(), Bound::minimum, path + ".bound");
  result.value = finite(message.value(), path + ".value");
  if (message.has_ends()) result.ends = finite(message.ends(), path + ".ends");
  return result;
}

ConstraintKind kind_from_proto(const v1::Constraint& message, const std::string& path) {
  switch (message.kind_case()) {
    case v1::Constraint::kPlanar:
      return Planar{};
    case v1::Constraint::kCircular:
      return Circular{size_of(message.circular().radius(), path + ".circular.radius")};
    case v1::Constraint::kCylindrical:
      return Cylindrical{size_of(message.cylindrical().radius(), path + ".cylindrical.radius")};
    case v1::Constraint::kSpherical:
      return Spherical{size_of(message.spherical().radius(), path + ".spherical.radius")};
    case v1::Constraint::kConical:
      return Conical{size_of(message.conical().angle(), path + ".conical.angle")};
    case v1::Constraint::kStraight:
      return Straight{};
    case v1::Constraint::kFeatureLine:
      return FeatureLine{};
    case v1::Constraint::kRigid:
      return Rigid{fitting_int(message.rigid().layers(), path + ".rigid.layers")};
    case v1::Constraint::kFixedPlane:
      return FixedPlane{vec3(message.fixed_plane().point(), path + ".fixed_plane.point"),
                        vec3(message.fixed_plane().normal(), path + ".fixed_plane.normal")};
    case v1::Constraint::kSymmetric:
      return symmetric(message.symmetric(), path + ".symmetric");
    case v1::Constraint::kCoplanar:
      return Coplanar{};
    case v1::Constraint::kParallel:
      return Parallel{};
    case v1::Constraint::kOrthogonal:
      return Orthogonal{};
    case v1::Constraint::kDistance:
      return distance(message.distance(), path + ".distance");
    case v1::Constraint::kExtent:
      return extent(message.extent(), path + ".extent");
    case v1::Constraint::KIND_NOT_SET:
      break;
  }
  refuse_field(path, "no kind of constraint is given (planar, circular, cylindrical, ...)");
}

bool has_exact(const v1::Setup& setup) {
  return std::any_of(setup.constraints().begin(), setup.constraints().end(), [](const auto& each) { return each.exact(); });
}

/// How setups were stored before there was `exact_steps`: without it, but with what else has a default.
bool stored_without_exact_steps(const v1::Setup& setup) {
  const v1::ConstraintOptions& options = setup.constraint_options();
  const v1::Energy* const energy = energy_of(setup.method());
  return options.exact_steps() == v1::EXACT_STEPS_DEFAULT && options.tolerance() != 0 && options.iterations() != 0 &&
         energy != nullptr && energy->has_bending() && energy->handles() != v1::HANDLES_DEFAULT;
}

/// Ignored without exact constraints: of these the canonical form does not name it, so that it would look as if stored long ago.
ExactSteps exact_steps(const v1::Setup& setup) {
  const bool centres =
      known(setup.constraint_options().exact_steps(), "constraint_options.exact_steps") == v1::EXACT_STEPS_AT_CENTRES ||
      stored_without_exact_steps(setup);
  return centres && has_exact(setup) ? ExactSteps::centres : ExactSteps::joins;
}

}  // namespace

Constraint constraint_from_proto(const v1::Constraint& message, const std::string& path) {
  Constraint constraint{message.name(), {}, kind_from_proto(message, path), message.weight(), message.exact()};
  for (int i = 0; i < message.regions_size(); ++i) {
    constraint.regions.push_back(region_from_proto(message.regions(i), path + ".regions[" + std::to_string(i) + "]"));
  }
  return constraint;
}

ConstraintOptions constraint_options_from_proto(const v1::Setup& setup) {
  const v1::ConstraintOptions& message = setup.constraint_options();
  ConstraintOptions options;
  options.exact_steps = exact_steps(setup);
  if (message.tolerance() != 0) options.tolerance = message.tolerance();
  if (message.iterations() != 0) options.iterations = fitting_int(message.iterations(), "constraint_options.iterations");
  validate_constraint_options(options);  // also those that say nothing, as there are no constraints
  return options;
}

void canonicalize_constraint_options(v1::Setup& setup) {
  if (setup.constraints().empty()) {
    setup.clear_constraint_options();  // ignored
    return;
  }
  const ConstraintOptions defaults;
  v1::ConstraintOptions& message = *setup.mutable_constraint_options();
  const bool named = has_exact(setup) && exact_steps(setup) == ExactSteps::joins;
  message.set_exact_steps(named ? v1::EXACT_STEPS_AT_JOINS : v1::EXACT_STEPS_DEFAULT);
  if (message.tolerance() == 0) message.set_tolerance(defaults.tolerance);
  if (message.iterations() == 0) message.set_iterations(static_cast<std::uint32_t>(defaults.iterations));
}

void canonicalize_constraint(v1::Constraint& message) {
  for (auto& region : *message.mutable_regions()) canonicalize_region(region);
  const auto fill = [](v1::Size size) { return size == v1::SIZE_DEFAULT ? v1::FREE : size; };
  if (message.has_circular()) message.mutable_circular()->set_radius(fill(message.circular().radius()));
  if (message.has_cylindrical()) message.mutable_cylindrical()->set_radius(fill(message.cylindrical().radius()));
  if (message.has_spherical()) message.mutable_spherical()->set_radius(fill(message.spherical().radius()));
  if (message.has_conical()) message.mutable_conical()->set_angle(fill(message.conical().angle()));
  if (message.has_symmetric() && message.symmetric().tolerance() == 0) {
    message.mutable_symmetric()->set_tolerance(Symmetric().tolerance);
  }
  if (message.has_distance() && message.distance().bound() == v1::BOUND_DEFAULT) message.mutable_distance()->set_bound(v1::EQUAL);
  if (message.has_extent()) {
    if (message.extent().bound() == v1::BOUND_DEFAULT) message.mutable_extent()->set_bound(v1::MINIMUM);
    if (!message.extent().has_ends()) message.mutable_extent()->set_ends(Extent().ends);
  }
}

}  // namespace deform::convert
