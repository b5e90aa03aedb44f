// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/region.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <optional>
#include <span>
#include <type_traits>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/mesh/adjacency.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/smooth_patch.h"

namespace deform {

namespace {

using Mask = std::vector<char>;

std::string three_digits(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

constexpr int max_depth = 64;
constexpr double largest_seed_distance = 0.05;  // of D
constexpr int max_rings = 1000;

template <typename Kind>
concept CombinedRegion = std::is_same_v<Kind, Region::Union> || std::is_same_v<Kind, Region::Intersection> ||
    std::is_same_v<Kind, Region::Difference> || std::is_same_v<Kind, Region::Complement>;

/// Combines selections of points or control points. They are masks and not id lists, so that a combinator is one pass over bytes.
class Combiner {
 public:
  Combiner(const std::string& what, const RunContext& context) : what_(what), context_(context) {}
  virtual ~Combiner() = default;

  Mask mask(const Region& region, int depth) {
    if (depth > max_depth) refuse("regions are nested deeper than " + std::to_string(max_depth));
    context_.check();
    return of_kind(region, depth);
  }

 protected:
  /// Evaluates a region of any kind.
  virtual Mask of_kind(const Region& region, int depth) = 0;

  [[noreturn]] void refuse(const std::string& message) const { throw Error(ErrorCode::invalid_argument, what_ + ": " + message); }
  void require_one(std::size_t children, const char* field) const {
    if (children != 1) refuse(std::string(field) + ": needs exactly one region, not " + std::to_string(children));
  }
  void require_some(std::size_t children, const char* field) const {
    if (children == 0) refuse(std::string(field) + ": needs at least one region");
  }

  Mask combined(const Region::Union& region, int depth) {
    require_some(region.of.size(), "union");
    Mask result = mask(region.of[0], depth + 1);
    for (std::size_t child = 1; child < region.of.size(); ++child) {
      const Mask other = mask(region.of[child], depth + 1);
      for (std::size_t i = 0; i < result.size(); ++i) result[i] |= other[i];
    }
    return result;
  }

  Mask combined(const Region::Intersection& region, int depth) {
    require_some(region.of.size(), "intersection");
    Mask result = mask(region.of[0], depth + 1);
    for (std::size_t child = 1; child < region.of.size(); ++child) {
      const Mask other = mask(region.of[child], depth + 1);
      for (std::size_t i = 0; i < result.size(); ++i) result[i] &= other[i];
    }
    return result;
  }

  Mask combined(const Region::Difference& region, int depth) {
    require_some(region.of.size(), "difference");
    Mask result = mask(region.of[0], depth + 1);
    for (std::size_t child = 1; child < region.of.size(); ++child) {
      const Mask other = mask(region.of[child], depth + 1);
      for (std::size_t i = 0; i < result.size(); ++i) result[i] = result[i] && !other[i];
    }
    return result;
  }

  Mask combined(const Region::Complement& region, int depth) {
    require_one(region.of.size(), "complement");
    Mask result = mask(region.of[0], depth + 1);
    for (char& selected : result) selected = !selected;
    return result;
  }

  const std::string& what_;
  const RunContext& context_;
};

/// Evaluates one region tree on one mesh.
class MeshSelector : public Combiner {
 public:
  MeshSelector(const Mesh& mesh, const std::string& what, const RunContext& context) : Combiner(what, context), mesh_(mesh) {}

 private:
  Mask of_kind(const Region& region, int depth) override {
    return std::visit([&](const auto& kind) { return select(kind, depth); }, region.kind);
  }

  // Combiner handles these.
  template <CombinedRegion Kind>
  Mask select(const Kind& kind, int depth) {
    return combined(kind, depth);
  }
  Mask select(const Region::LatticeRange&, int) const { refuse_controls("lattice"); }
  Mask select(const Region::ControlIds&, int) const { refuse_controls("control"); }
  [[noreturn]] void refuse_controls(const char* field) const {
    refuse(std::string(field) +
           ": control points can be selected only by handles and fixed regions, and only with control "
           "CONTROLS of method.ffd or method.cage; here take points of the mesh");
  }

  void require_radius(double radius, const char* field) const {
    if (!std::isfinite(radius) || radius < 0) {
      refuse(std::string(field) + ": it must be a finite number that is not negative, not " + number_digits(radius));
    }
  }
  template <typename Predicate>
  Mask where(Predicate inside) const {
    Mask mask(mesh_.point_count());
    for (std::size_t i = 0; i < mask.size(); ++i) mask[i] = inside(mesh_.points[i]);
    return mask;
  }

  const Adjacency& adjacency() {
    if (!adjacency_) adjacency_.emplace(mesh_);
    return *adjacency_;
  }

  Mask select(const Region::All&, int) const { return Mask(mesh_.point_count(), 1); }

  Mask select(const Region::GroupName& region, int) {
    const Group* group = mesh_.find_group(region.name);
    if (!group) refuse(unknown_group(region.name));
    if (offsets_.empty()) offsets_ = mesh_.face_offsets();
    Mask mask(mesh_.point_count(), 0);
    for (const PointId point : group->points) mask[point] = 1;
    for (const FaceId face : group->faces) {
      for (std::uint64_t c = offsets_[face]; c < offsets_[face + 1]; ++c) mask[mesh_.face_points[c]] = 1;
    }
    return mask;
  }

  std::string unknown_group(const std::string& name) const {
    std::string message = "group \"" + name + "\" does not exist";
    if (mesh_.groups.empty()) return message + "; the geometry has no groups";
    std::vector<std::string> names;
    for (const Group& group : mesh_.groups) names.push_back(group.name);
    const std::string nearest = nearest_names(name, names);
    if (!nearest.empty()) return message + "; did you mean " + nearest + "?";
    message += "; the geometry has ";
    constexpr std::size_t listed = 8;
    for (std::size_t i = 0; i < std::min(listed, names.size()); ++i) message += (i ? ", \"" : "\"") + names[i] + "\"";
    return names.size() > listed ? message + " and " + std::to_string(names.size() - listed) + " more" : message;
  }

  Mask select(const Region::InBox& box, int) const {
    check_finite(box.min, what_ + ": box.min");
    check_finite(box.max, what_ + ": box.max");
    for (int k = 0; k < 3; ++k) {
      if (box.min[k] > box.max[k]) {
        refuse(std::string("box: min.") + "xyz"[k] + " = " + number_digits(box.min[k]) + " is greater than max." + "xyz"[k] +
               " = " + number_digits(box.max[k]));
      }
    }
    return where([&](const Vec3& p) {
      return p[0] >= box.min[0] && p[0] <= box.max[0] && p[1] >= box.min[1] && p[1] <= box.max[1] && p[2] >= box.min[2] &&
             p[2] <= box.max[2];
    });
  }

  Mask select(const Region::InSphere& sphere, int) const {
    check_finite(sphere.centre, what_ + ": sphere.centre");
    require_radius(sphere.radius, "sphere.radius");
    return where([&](const Vec3& p) { return distance(p, sphere.centre) <= sphere.radius; });
  }

  Mask select(const Region::InCylinder& cylinder, int) const {
    check_finite(cylinder.start, what_ + ": cylinder.start");
    check_finite(cylinder.end, what_ + ": cylinder.end");
    require_radius(cylinder.radius, "cylinder.radius");
    const Vec3 axis = cylinder.end - cylinder.start;
    const double length = norm(axis);
    if (!(length > 0) || !std::isfinite(length)) refuse("cylinder: start and end must differ, the axis has no length");
    const Vec3 unit = axis / length;
    return where([&](const Vec3& p) {
      // Measured from both ends, so that points exactly on either cap belong to it in spite of rounding.
      const Vec3 from_start = p - cylinder.start;
      const double along = dot(from_start, unit);
      if (along < 0 || dot(p - cylinder.end, unit) > 0) return false;
      return distance(from_start, along * unit) <= cylinder.radius;
    });
  }

  Mask select(const Region::InHalfSpace& half, int) const {
    check_finite(half.point, what_ + ": half_space.point");
    check_finite(half.normal, what_ + ": half_space.normal");
    if (half.normal == Vec3{0, 0, 0}) refuse("half_space.normal: it must not be zero");
    return where([&](const Vec3& p) { return dot(p - half.point, half.normal) >= 0; });
  }

  Mask select(const Region::Ids& region, int) const {
    Mask mask(mesh_.point_count(), 0);
    check_ids(region.ids, mask.size(), what_ + ": ids", "point");
    for (const PointId id : region.ids) mask[id] = 1;
    return mask;
  }

  Mask select(const Region::OpenBoundary&, int) { return adjacency().boundary_points(); }

  Mask select(const Region::Boundary&, int) const {
    if (mesh_.elements) return corners(sides(*mesh_.elements, "boundary").points);
    if (mesh_.cells) {
      const PolyhedralCells& cells = *mesh_.cells;
      return corners(std::span(cells.face_points).subspan(cells.face_offsets[cells.internal_faces()]));
    }
    return corners(mesh_.face_points);
  }

  BoundaryFaces sides(const Elements& elements, const char* kind) const {
    try {
      return boundary_faces(elements);
    } catch (const Error& error) {
      refuse(std::string(kind) + ": " + error.what());
    }
  }

  Mask select(const Region::Patch& patch, int) const {
    if (!(patch.angle > 0 && patch.angle <= 180)) {
      refuse("patch.angle: it must be over 0 and up to 180 degrees, not " + number_digits(patch.angle));
    }
    if (mesh_.elements) {
      const BoundaryFaces faces = sides(*mesh_.elements, "patch");
      return points_of(patch, {mesh_.points, faces.sizes, faces.points});
    }
    if (!mesh_.cells) return points_of(patch, {mesh_.points, mesh_.face_sizes, mesh_.face_points});
    const PolyhedralCells& cells = *mesh_.cells;
    std::vector<std::uint32_t> sizes;
    for (std::size_t f = cells.internal_faces(); f < cells.face_count(); ++f) {
      sizes.push_back(static_cast<std::uint32_t>(cells.face(f).size()));
    }
    return points_of(patch,
                     {mesh_.points, sizes, std::span(cells.face_points).subspan(cells.face_offsets[cells.internal_faces()])});
  }

  Mask points_of(const Region::Patch& patch, const SurfaceFaces& surface) const {
    const std::vector<char> marked = smooth_patch(surface, seeds(patch, surface), patch.angle);
    Mask mask(mesh_.point_count(), 0);
    std::size_t first = 0;
    for (std::size_t f = 0; f < marked.size(); ++f) {
      const auto corners = surface.corners.subspan(first, surface.sizes[f]);
      first += corners.size();
      if (!marked[f]) continue;
      for (const PointId point : corners) mask[point] = 1;
    }
    return mask;
  }

  std::vector<std::size_t> seeds(const Region::Patch& patch, const SurfaceFaces& surface) const {
    if (const auto* place = std::get_if<Vec3>(&patch.seed)) {
      check_finite(*place, what_ + ": patch.seed");
      const NearestFace nearest = nearest_face(surface, *place);
      if (nearest.face == surface.sizes.size()) refuse("patch: the geometry has no faces of three corners or more");
      const double limit = largest_seed_distance * bounding_box(mesh_.points).diagonal();
      if (nearest.distance > limit) {
        refuse("patch.seed: the place is " + three_digits(nearest.distance) + " from the surface, must be at most " +
               three_digits(limit) + ", " + number_digits(100 * largest_seed_distance) +
               " % of the diagonal of the mesh; name a place on the surface, in the units of the mesh, or a point of it");
      }
      return {nearest.face};
    }
    const PointId point = std::get<PointId>(patch.seed);
    check_ids(std::span(&point, 1), mesh_.point_count(), what_ + ": patch.point", "point");
    std::vector<std::size_t> faces;
    std::size_t first = 0;
    for (std::size_t f = 0; f < surface.sizes.size(); ++f) {
      const auto corners = surface.corners.subspan(first, surface.sizes[f]);
      first += corners.size();
      if (corners.size() >= 3 && std::find(corners.begin(), corners.end(), point) != corners.end()) faces.push_back(f);
    }
    if (faces.empty())
      refuse("patch.point: point " + std::to_string(point) + " is not on the surface, it is no corner of a face");
    return faces;
  }

  Mask corners(std::span<const PointId> points) const {
    Mask mask(mesh_.point_count(), 0);
    for (const PointId point : points) mask[point] = 1;
    return mask;
  }

  Mask select(const Region::Grow& region, int depth) {
    require_one(region.of.size(), "grow");
    if (region.rings < 0 || region.rings > max_rings) {
      refuse("grow.rings: " + std::to_string(region.rings) + " is outside 0.." + std::to_string(max_rings));
    }
    const Mask seed = mask(region.of[0], depth + 1);
    return region.rings == 0 ? seed : adjacency().grow(seed, region.rings);
  }

  const Mesh& mesh_;
  std::vector<std::uint64_t> offsets_;
  std::optional<Adjacency> adjacency_;  // built for the first selection that needs neighbours
};

/// Evaluates one region tree on control points.
class ControlSelector : public Combiner {
 public:
  ControlSelector(const ControlSet& controls, const std::string& what, const RunContext& context)
      : Combiner(what, context), controls_(controls) {}

 private:
  Mask of_kind(const Region& region, int depth) override {
    return std::visit([&](const auto& kind) { return select(kind, depth); }, region.kind);
  }

  template <CombinedRegion Kind>
  Mask select(const Kind& kind, int depth) {
    return combined(kind, depth);
  }
  template <typename Kind>
  Mask select(const Kind&, int) {
    refuse(std::string("its region selects points of the mesh, but with control CONTROLS handles and fixed regions select "
                       "control points: ") +
           (controls_.lattice ? "`lattice: {i: [FIRST, LAST], j: .., k: ..}`, " : "") +
           "`control: {ids: [..]}` and what combines these");
  }
  Mask select(const Region::ControlIds& region, int) {
    Mask mask(controls_.size, 0);
    check_ids(region.ids, mask.size(), what_ + ": control.ids", "control point");
    for (const std::uint32_t id : region.ids) mask[id] = 1;
    return mask;
  }
  Mask select(const Region::LatticeRange& region, int) {
    if (!controls_.lattice) refuse("lattice: there is none; use `control: {ids: [..]}`");
    std::array<Region::LatticeRange::Range, 3> ranges;
    for (std::size_t k = 0; k < 3; ++k) ranges[k] = range(region, k);
    Mask mask(controls_.size, 0);
    const auto& [l, m, n] = *controls_.lattice;
    for (std::size_t k = ranges[2].first; k <= ranges[2].last; ++k) {
      for (std::size_t j = ranges[1].first; j <= ranges[1].last; ++j) {
        for (std::size_t i = ranges[0].first; i <= ranges[0].last; ++i) mask[i + l * (j + m * k)] = 1;
      }
    }
    return mask;
  }

  Region::LatticeRange::Range range(const Region::LatticeRange& region, std::size_t axis) const {
    const std::size_t points = (*controls_.lattice)[axis];
    const Region::LatticeRange::Range given =
        region.along[axis].value_or(Region::LatticeRange::Range{0, static_cast<std::uint32_t>(points - 1)});
    if (given.first <= given.last && given.last < points) return given;
    refuse(std::string("lattice.") + "ijk"[axis] + ": [" + std::to_string(given.first) + ", " + std::to_string(given.last) +
           "] must be the first and the last of the " + std::to_string(points) + " control points along that axis, from 0 to " +
           std::to_string(points - 1));
  }

  const ControlSet& controls_;
};

std::vector<PointId> ids_of(const Mask& mask) {
  std::vector<PointId> ids;
  ids.reserve(static_cast<std::size_t>(std::count_if(mask.begin(), mask.end(), [](auto selected) { return selected != 0; })));
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask[i]) ids.push_back(static_cast<PointId>(i));
  }
  return ids;
}

/// The shortest digits that mean the same number.
void append(double value, std::string& text) {
  char digits[32];
  text.append(digits, std::to_chars(std::begin(digits), std::end(digits), value).ptr);
}

void append(const Vec3& corner, std::string& text) {
  for (std::size_t k = 0; k < 3; ++k) {
    text += k == 0 ? "[" : ", ";
    append(corner[k], text);
  }
  text += ']';
}

}  // namespace

std::string no_point_text(const Mesh& mesh) {
  const Box box = bounding_box(mesh.points);
  std::string text = "its region contains no point; the model's box is ";
  append(box.min, text);
  text += " to ";
  append(box.max, text);
  return text;
}

std::vector<PointId> select(const Region& region, const Mesh& mesh, const std::string& what, const RunContext& context) {
  return ids_of(MeshSelector(mesh, what, context).mask(region, 1));
}

std::vector<PointId> select_controls(const Region& region, const ControlSet& controls, const std::string& what,
                                     const RunContext& context) {
  return ids_of(ControlSelector(controls, what, context).mask(region, 1));
}

}  // namespace deform
