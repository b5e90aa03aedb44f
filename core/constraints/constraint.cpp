// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/constraint.h"

#include <cmath>

#include "core/base/checks.h"
#include "core/base/direction.h"
#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/constraints/circle.h"
#include "core/constraints/cone.h"
#include "core/constraints/cylinder.h"
#include "core/constraints/distance.h"
#include "core/constraints/extent.h"
#include "core/constraints/fitting.h"
#include "core/constraints/matched_shape.h"
#include "core/constraints/pairing.h"
#include "core/constraints/plane.h"
#include "core/constraints/related_planes.h"
#include "core/constraints/sphere.h"
#include "core/constraints/symmetric.h"

namespace deform {

namespace {

using Regions = std::span<const std::vector<Vec3>>;

constexpr std::size_t any_number = 1000;  ///< of regions

/// Name, what becomes of mirror images, numbers of regions, points in all and in each.
struct Needs {
  std::string_view name;
  Mirroring mirroring;
  std::size_t least_regions = 1, most_regions = 1, points = 1, points_each = 1;
};

struct NeedsOf {
  Needs operator()(const Planar&) const { return {"planar", Mirroring::shape, 1, 1, 4}; }
  Needs operator()(const Circular&) const { return {"circular", Mirroring::shape, 1, 1, 4}; }
  Needs operator()(const Cylindrical&) const { return {"cylindrical", Mirroring::shape, 1, 1, 6}; }
  Needs operator()(const Spherical&) const { return {"spherical", Mirroring::shape, 1, 1, 5}; }
  Needs operator()(const Conical&) const { return {"conical", Mirroring::shape, 1, 1, 7}; }
  Needs operator()(const Straight&) const { return {"straight", Mirroring::shape, 1, 1, 3}; }
  Needs operator()(const FeatureLine&) const { return {"feature_line", Mirroring::shape, 1, 1, 3}; }
  Needs operator()(const Rigid& kind) const {
    return {"rigid", kind.layers == 0 ? Mirroring::shape : Mirroring::relation, 1, 1, 2};
  }
  Needs operator()(const FixedPlane&) const { return {"fixed_plane", Mirroring::direction, 1, 1, 1}; }
  Needs operator()(const Symmetric&) const { return {"symmetric", Mirroring::direction, 1, 2, 3}; }
  Needs operator()(const Coplanar&) const { return {"coplanar", Mirroring::relation, 2, any_number, 4}; }
  Needs operator()(const Parallel&) const { return {"parallel", Mirroring::relation, 2, any_number, 6, 3}; }
  Needs operator()(const Orthogonal&) const { return {"orthogonal", Mirroring::relation, 2, 2, 6, 3}; }
  Needs operator()(const Distance&) const { return {"distance", Mirroring::relation, 2, 2, 2}; }
  Needs operator()(const Extent&) const { return {"extent", Mirroring::direction, 1, 1, 2}; }
};

struct PlacementOf {
  Placement operator()(Planar&) const { return {}; }
  Placement operator()(Circular&) const { return {}; }
  Placement operator()(Cylindrical&) const { return {}; }
  Placement operator()(Spherical&) const { return {}; }
  Placement operator()(Conical&) const { return {}; }
  Placement operator()(Straight&) const { return {}; }
  Placement operator()(FeatureLine&) const { return {}; }
  Placement operator()(Rigid&) const { return {}; }
  Placement operator()(FixedPlane& kind) const { return {{&kind.point}, {&kind.normal}}; }
  Placement operator()(Symmetric& kind) const {
    return kind.plane ? Placement{{&kind.plane->point}, {&kind.plane->normal}} : Placement{};
  }
  Placement operator()(Coplanar&) const { return {}; }
  Placement operator()(Parallel&) const { return {}; }
  Placement operator()(Orthogonal&) const { return {}; }
  Placement operator()(Distance&) const { return {}; }
  Placement operator()(Extent& kind) const { return {{}, {&kind.axis}}; }
};

struct NumbersOf {
  using Numbers = std::vector<double>;
  static Numbers of(Size size) { return {static_cast<double>(size)}; }
  static Numbers of(const Vec3& a, const Vec3& b) { return {a[0], a[1], a[2], b[0], b[1], b[2]}; }

  Numbers operator()(const Planar&) const { return {}; }
  Numbers operator()(const Circular& kind) const { return of(kind.radius); }
  Numbers operator()(const Cylindrical& kind) const { return of(kind.radius); }
  Numbers operator()(const Spherical& kind) const { return of(kind.radius); }
  Numbers operator()(const Conical& kind) const { return of(kind.angle); }
  Numbers operator()(const Straight&) const { return {}; }
  Numbers operator()(const FeatureLine&) const { return {}; }
  Numbers operator()(const Rigid& kind) const { return {static_cast<double>(kind.layers)}; }
  Numbers operator()(const FixedPlane& kind) const { return of(kind.point, kind.normal); }
  Numbers operator()(const Symmetric& kind) const {
    Numbers numbers = kind.plane ? of(kind.plane->point, kind.plane->normal) : Numbers{};
    numbers.push_back(kind.tolerance);
    return numbers;
  }
  Numbers operator()(const Coplanar&) const { return {}; }
  Numbers operator()(const Parallel&) const { return {}; }
  Numbers operator()(const Orthogonal&) const { return {}; }
  Numbers operator()(const Distance& kind) const { return {static_cast<double>(kind.bound), kind.value.value_or(0)}; }
  Numbers operator()(const Extent& kind) const {
    return {kind.axis[0], kind.axis[1], kind.axis[2], static_cast<double>(kind.bound), kind.value, kind.ends};
  }
};

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
    check_finite(rest[r], region + ".points");
    all += rest[r].size();
  }
  if (all < needs.points) {
    refuse(what + ".regions", std::to_string(all) + " points, " + name + " needs at least " + std::to_string(needs.points));
  }
}

void check_units(const UnitMap& units) {
  if (!is_finite(units.origin) || !std::isfinite(units.scale) || !(units.scale > 0)) {
    refuse("units", "the origin must be finite and the scale finite and positive");
  }
}

Vec3 direction(const Vec3& v, const std::string& field) {
  if (const char* problem = direction_problem(v)) refuse(field, std::string("it ") + problem);
  return v / norm(v);
}

Vec3 to_unit(const Vec3& point, const UnitMap& units, const std::string& field) {
  if (!is_finite(point)) refuse(field, "must be finite");
  return (point - units.origin) / units.scale;
}

/// The curvature at rest if it is to be kept, otherwise std::nullopt. Coplanar points have no radius to keep.
std::optional<double> kept_curvature(Size size, double (*curvature)(std::span<const Vec3>), std::span<const Vec3> rest,
                                     const std::string& what) {
  if (size == Size::free) return {};
  const double k = curvature(rest);
  if (!(k * spread({rest}).radius > 1e-4)) refuse(what + ".radius", "cannot be kept: the points at rest are flat");
  return k;
}

/// Makes each kind; the numbers of regions and points have been checked.
class Maker {
 public:
  Maker(Regions rest, const UnitMap& units, const std::string& what) : rest_(rest), units_(units), what_(what) {
    for (const auto& region : rest) all_.insert(all_.end(), region.begin(), region.end());
  }

  using Made = std::unique_ptr<const Projection>;

  Made operator()(const Planar&) const { return plane_projection(all_.size()); }
  Made operator()(const Coplanar&) const { return plane_projection(all_.size()); }
  Made operator()(const Straight&) const { return line_projection(all_.size()); }
  Made operator()(const Circular& kind) const {
    return circle_projection(all_.size(), kept_curvature(kind.radius, circle_curvature, all_, what_));
  }
  Made operator()(const Cylindrical& kind) const {
    return cylinder_projection(all_.size(), kept_curvature(kind.radius, cylinder_curvature, all_, what_));
  }
  Made operator()(const Spherical& kind) const {
    return sphere_projection(all_.size(), kept_curvature(kind.radius, sphere_curvature, all_, what_));
  }
  Made operator()(const FeatureLine&) const { return matched_projection(all_, Match::similar); }
  Made operator()(const Rigid&) const { return matched_projection(all_, Match::rigid); }
  Made operator()(const FixedPlane& kind) const {
    return fixed_plane_projection(to_unit(kind.point, units_, what_ + ".point"), direction(kind.normal, what_ + ".normal"),
                                  all_.size());
  }
  Made operator()(const Conical& kind) const {
    return cone_projection(all_.size(), kind.angle == Size::free ? std::nullopt : std::optional<double>(cone_angle(all_)));
  }
  Made operator()(const Parallel&) const { return parallel_projection(counts()); }
  Made operator()(const Orthogonal&) const { return orthogonal_projection(counts()); }
  Made operator()(const Symmetric& kind) const;
  Made operator()(const Distance& kind) const;
  Made operator()(const Extent& kind) const;

 private:
  std::vector<std::size_t> counts() const {
    std::vector<std::size_t> points;
    for (const auto& region : rest_) points.push_back(region.size());
    return points;
  }

  Regions rest_;
  const UnitMap& units_;
  const std::string& what_;
  std::vector<Vec3> all_;  ///< points of all regions
};

Maker::Made Maker::operator()(const Symmetric& kind) const {
  if (!(kind.tolerance > 0 && kind.tolerance <= 0.1)) refuse(what_ + ".tolerance", "must be above 0 and at most 0.1");
  const double tolerance = kind.tolerance * bounding_box(all_).diagonal();
  std::optional<MirrorPlane> plane;
  if (kind.plane) {
    plane = MirrorPlane{to_unit(kind.plane->point, units_, what_ + ".plane.point"),
                        direction(kind.plane->normal, what_ + ".plane.normal")};
  } else {
    plane = find_mirror_plane(all_, rest_[0].size(), tolerance);
    if (!plane) refuse(what_ + ".plane", "none found in which the points at rest are symmetric; give one");
  }
  MirrorPairs pairs = mirror_pairs(all_, rest_[0].size(), *plane, tolerance);
  if (pairs.unmatched > 0) {
    refuse(what_ + ".regions", std::to_string(pairs.unmatched) + " of " + std::to_string(all_.size()) +
                                   " points have no partner within the tolerance of their mirror image, the first is point " +
                                   std::to_string(pairs.first_unmatched));
  }
  return symmetric_projection(std::move(pairs.partner));
}

Maker::Made Maker::operator()(const Distance& kind) const {
  if (kind.value && !(std::isfinite(*kind.value) && *kind.value > 0)) refuse(what_ + ".value", "must be finite and above 0");
  std::vector<PointPair> pairs;
  for (const auto& [i, k] : mutual_pairs(rest_[0], rest_[1])) {
    const Eigen::Vector3d apart = to_eigen(rest_[0][i]) - to_eigen(rest_[1][k]);
    if (!(apart.norm() > 1e-12)) {
      refuse(what_ + ".regions",
             "point " + std::to_string(i) + " of the first and point " + std::to_string(k) + " of the second coincide at rest");
    }
    PointPair pair{i, static_cast<std::uint32_t>(rest_[0].size()) + k};
    pair.direction = to_vec3(apart.normalized());
    const double value = kind.value ? *kind.value / units_.scale : apart.norm();
    if (kind.bound != Bound::maximum) pair.least = value;
    if (kind.bound != Bound::minimum) pair.most = value;
    pairs.push_back(pair);
  }
  return distance_projection(std::move(pairs), all_.size());
}

Maker::Made Maker::operator()(const Extent& kind) const {
  const Vec3 axis = direction(kind.axis, what_ + ".axis");
  if (!(std::isfinite(kind.value) && kind.value >= 0)) refuse(what_ + ".value", "must be finite and not negative");
  const double value = kind.value / units_.scale;
  if (kind.bound == Bound::equal) refuse(what_ + ".bound", "must be minimum or maximum; two constraints make an equality");
  if (kind.bound == Bound::maximum) return largest_extent_projection(axis, value, all_.size());
  if (!(kind.ends >= 0 && kind.ends < 0.5)) refuse(what_ + ".ends", "must be at least 0 and below 0.5");
  const ExtentEnds ends = extent_ends(all_, axis, kind.ends);
  if (ends.upper.empty()) refuse(what_ + ".regions", "the points at rest have no extent along the axis");
  return least_extent_projection(axis, value, ends, all_.size());
}

}  // namespace

std::string_view kind_name(const ConstraintKind& kind) { return std::visit(NeedsOf{}, kind).name; }

Mirroring mirroring_of(const ConstraintKind& kind) { return std::visit(NeedsOf{}, kind).mirroring; }

Placement placement_of(ConstraintKind& kind) { return std::visit(PlacementOf{}, kind); }

std::vector<double> numbers_of(const ConstraintKind& kind) { return std::visit(NumbersOf{}, kind); }

std::array<std::size_t, 2> region_counts(const ConstraintKind& kind) {
  const Needs needs = std::visit(NeedsOf{}, kind);
  return {needs.least_regions, needs.most_regions};
}

std::size_t least_points(const ConstraintKind& kind) { return std::visit(NeedsOf{}, kind).points; }

std::unique_ptr<const Projection> make_projection(const ConstraintKind& kind, Regions rest, const UnitMap& units,
                                                  const std::string& what) {
  check_units(units);
  check_points(std::visit(NeedsOf{}, kind), rest, what);
  return std::visit(Maker(rest, units, what), kind);
}

}  // namespace deform
