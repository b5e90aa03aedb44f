#include "core/constraints/constraint.h"

#include <cmath>

#include "core/base/error.h"
#include "core/constraints/circle.h"
#include "core/constraints/cylinder.h"
#include "core/constraints/fitting.h"
#include "core/constraints/matched_shape.h"
#include "core/constraints/plane.h"
#include "core/constraints/sphere.h"

namespace deform {

namespace {

using Regions = std::span<const std::vector<Vec3>>;

constexpr std::size_t any_number = 1000;  ///< of regions

/// Name, numbers of regions, points in all and in each.
struct Needs {
  std::string_view name;
  std::size_t least_regions = 1, most_regions = 1, points = 1, points_each = 1;
};

struct NeedsOf {
  Needs operator()(const Planar&) const { return {"planar", 1, 1, 4}; }
  Needs operator()(const Circular&) const { return {"circular", 1, 1, 4}; }
  Needs operator()(const Cylindrical&) const { return {"cylindrical", 1, 1, 6}; }
  Needs operator()(const Spherical&) const { return {"spherical", 1, 1, 5}; }
  Needs operator()(const Conical&) const { return {"conical", 1, 1, 7}; }
  Needs operator()(const Straight&) const { return {"straight", 1, 1, 3}; }
  Needs operator()(const FeatureLine&) const { return {"feature_line", 1, 1, 3}; }
  Needs operator()(const Rigid&) const { return {"rigid", 1, 1, 2}; }
  Needs operator()(const FixedPlane&) const { return {"fixed_plane", 1, 1, 1}; }
  Needs operator()(const Symmetric&) const { return {"symmetric", 1, 2, 3}; }
  Needs operator()(const Coplanar&) const { return {"coplanar", 2, any_number, 4}; }
  Needs operator()(const Parallel&) const { return {"parallel", 2, any_number, 6, 3}; }
  Needs operator()(const Orthogonal&) const { return {"orthogonal", 2, 2, 6, 3}; }
  Needs operator()(const Distance&) const { return {"distance", 2, 2, 2}; }
  Needs operator()(const Extent&) const { return {"extent", 1, 1, 2}; }
};

bool finite(const Vec3& v) { return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]); }

[[noreturn]] void refuse(const std::string& field, const std::string& why) {
  throw Error(ErrorCode::invalid_argument, field + ": " + why);
}

void check_points(const Needs& needs, Regions rest, const std::string& what) {
  const std::string name(needs.name);
  if (rest.size() < needs.least_regions || rest.size() > needs.most_regions) {
    const std::string limit = needs.least_regions == needs.most_regions
                                  ? std::to_string(needs.least_regions)
                                  : std::to_string(needs.least_regions) + " to " + std::to_string(needs.most_regions);
    refuse(what + ".regions", std::to_string(rest.size()) + " given, " + name + " takes " + limit);
  }
  std::size_t all = 0;
  for (std::size_t r = 0; r < rest.size(); ++r) {
    const std::string region = what + ".regions[" + std::to_string(r) + "]";
    if (rest[r].size() < needs.points_each) {
      refuse(region, std::to_string(rest[r].size()) + " points, " + name + " needs at least " +
                         std::to_string(needs.points_each) + " in every region");
    }
    for (std::size_t i = 0; i < rest[r].size(); ++i) {
      if (!finite(rest[r][i])) refuse(region, "point " + std::to_string(i) + " is not finite");
    }
    all += rest[r].size();
  }
  if (all < needs.points) {
    refuse(what + ".regions", std::to_string(all) + " points, " + name + " needs at least " + std::to_string(needs.points));
  }
}

void check_units(const UnitMap& units) {
  if (!finite(units.origin) || !std::isfinite(units.scale) || !(units.scale > 0)) {
    refuse("units", "the origin must be finite and the scale finite and positive");
  }
}

Vec3 direction(const Vec3& v, const std::string& field) {
  const double length = std::hypot(v[0], v[1], v[2]);
  if (!std::isnormal(length)) refuse(field, "must be finite and not zero");
  return {v[0] / length, v[1] / length, v[2] / length};
}

Vec3 to_unit(const Vec3& point, const UnitMap& units, const std::string& field) {
  if (!finite(point)) refuse(field, "must be finite");
  Vec3 unit{};
  for (std::size_t k = 0; k < 3; ++k) unit[k] = (point[k] - units.origin[k]) / units.scale;
  return unit;
}

/// Nothing, or the curvature at rest: what is flat there has no radius to keep.
std::optional<double> kept_curvature(Size size, double (*curvature)(std::span<const Vec3>), std::span<const Vec3> rest,
                                     const std::string& what) {
  if (size == Size::free) return {};
  const double k = curvature(rest);
  if (!(k * spread({rest}).radius > 1e-4)) refuse(what + ".radius", "cannot be kept: the points at rest are flat");
  return k;
}

struct Maker {
  Regions rest;
  const UnitMap& units;
  const std::string& what;
  std::vector<Vec3> all;  ///< points of all regions

  using Made = std::unique_ptr<const Projection>;

  Made operator()(const Planar&) const { return plane_projection(all.size()); }
  Made operator()(const Coplanar&) const { return plane_projection(all.size()); }
  Made operator()(const Straight&) const { return line_projection(all.size()); }
  Made operator()(const Circular& kind) const {
    return circle_projection(all.size(), kept_curvature(kind.radius, circle_curvature, all, what));
  }
  Made operator()(const Cylindrical& kind) const {
    return cylinder_projection(all.size(), kept_curvature(kind.radius, cylinder_curvature, all, what));
  }
  Made operator()(const Spherical& kind) const {
    return sphere_projection(all.size(), kept_curvature(kind.radius, sphere_curvature, all, what));
  }
  Made operator()(const FeatureLine&) const { return matched_projection(all, Match::similar); }
  Made operator()(const Rigid&) const { return matched_projection(all, Match::rigid); }
  Made operator()(const FixedPlane& kind) const {
    return fixed_plane_projection(to_unit(kind.point, units, what + ".point"), direction(kind.normal, what + ".normal"),
                                  all.size());
  }
  template <class Kind>
  Made operator()(const Kind&) const {
    refuse(what, "not available yet");
  }
};

}  // namespace

std::string_view kind_name(const ConstraintKind& kind) { return std::visit(NeedsOf{}, kind).name; }

std::array<std::size_t, 2> region_counts(const ConstraintKind& kind) {
  const Needs needs = std::visit(NeedsOf{}, kind);
  return {needs.least_regions, needs.most_regions};
}

std::unique_ptr<const Projection> make_projection(const ConstraintKind& kind, Regions rest, const UnitMap& units,
                                                  const std::string& what) {
  check_units(units);
  check_points(std::visit(NeedsOf{}, kind), rest, what);
  Maker maker{rest, units, what, {}};
  for (const auto& region : rest) maker.all.insert(maker.all.end(), region.begin(), region.end());
  return std::visit(maker, kind);
}

}  // namespace deform
