// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/mirrored_constraints.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/problems.h"
#include "core/base/vectors.h"
#include "core/constraints/constraint.h"
#include "core/constraints/projection.h"
#include "core/deformers/constrained/constraint_sets.h"
#include "core/deformers/handles/handle_motion.h"

namespace deform {

namespace {

constexpr double exact_distance = 1e-9;  // as ConstraintReport::missed
constexpr double misfit_growth = 5;      // a parabola whose vertex is in the plane has 4 times the misfit of its half to a line

using Places = std::vector<std::vector<PointId>>;  // of each region

ConstraintKind mirrored_kind(ConstraintKind kind, const MirroredMesh& mirrored, std::size_t image) {
  const Placement placement = placement_of(kind);
  for (Vec3* const point : placement.points) *point = mirrored.reflected_point(*point, image);
  for (Vec3* const direction : placement.directions) *direction = mirrored.reflected(*direction, image);
  return kind;
}

/// Image `image` of regions, joined with its own images in `planes`.
Places images_of(const Places& regions, const Symmetry& symmetry, const MirroredMesh& mirrored, std::size_t image,
                 std::size_t planes) {
  Places result;
  for (const std::vector<PointId>& ids : regions) {
    std::vector<PointId>& places = result.emplace_back();
    for (std::size_t g = 0; g < mirrored.images(); ++g) {
      if ((g & ~planes) != 0) continue;
      for (const PointId id : ids) {
        if ((symmetry.on(id) & g) == 0) places.push_back(mirrored.image(id, image | g));
      }
    }
    std::sort(places.begin(), places.end());
  }
  return result;
}

/// Root mean square distance of points at rest from the shape that fits them, as a fraction of D.
double misfit_at_rest(const ConstraintKind& kind, const Places& regions, const Mesh& whole, const UnitMap& units,
                      const std::string& what) {
  std::vector<std::vector<Vec3>> rest;
  std::vector<Vec3> x;
  for (const std::vector<PointId>& ids : regions) {
    std::vector<Vec3>& places = rest.emplace_back();
    for (const PointId id : ids) places.push_back((whole.points[id] - units.origin) / units.scale);
    x.insert(x.end(), places.begin(), places.end());
  }
  std::vector<Vec3> onto(x.size());
  ShapeParameters shape;
  const double squares = make_projection(kind, rest, units, what)->project(x, onto, shape);
  return std::sqrt(squares / static_cast<double>(x.size()));
}

/// The planes through which the shape of a constraint continues.
std::size_t continued_planes(const Constraint& constraint, const Places& regions, const Symmetry& symmetry,
                             const MirroredMesh& mirrored, const UnitMap& units, const std::string& what) {
  std::size_t touched = 0, within = ~std::size_t{0};
  for (const std::vector<PointId>& ids : regions) {
    for (const PointId id : ids) {
      touched |= symmetry.on(id);
      within &= symmetry.on(id);
    }
  }
  const Mirroring mirroring = mirroring_of(constraint.kind);
  if (mirroring != Mirroring::shape) return mirroring == Mirroring::direction ? 0 : within;
  const Mesh& whole = *mirrored.mesh();
  const double alone = touched == 0 ? 0 : misfit_at_rest(constraint.kind, regions, whole, units, what);
  std::size_t planes = 0;
  for (std::size_t k = 0; k < symmetry.planes(); ++k) {
    const std::size_t more = planes | std::size_t{1} << k;
    if ((touched >> k & 1u) == 0) continue;
    const double joined = misfit_at_rest(constraint.kind, images_of(regions, symmetry, mirrored, 0, more), whole, units, what);
    if (joined <= misfit_growth * alone + MirroredConstraints::continuity_tolerance) planes = more;
  }
  return planes;
}

void merge(const std::optional<ConstraintReport::Heights>& of, std::optional<ConstraintReport::Heights>& all) {
  if (!of) return;
  if (!all) all = of;
  all->add(of->least);
  all->add(of->largest);
}

std::vector<Region> regions_of(Places places) {
  std::vector<Region> result;
  for (std::vector<PointId>& ids : places) result.push_back({Region::Ids{std::move(ids)}});
  return result;
}

std::vector<ConstraintReport::Held> held_points(const std::vector<std::vector<PointId>>& of, const SelectedRegions& regions) {
  std::vector<ConstraintReport::Held> result;
  const auto count = [&](const std::vector<PointId>& holding, std::size_t handle) {
    std::size_t points = 0;
    for (const std::vector<PointId>& ids : of) {
      for (const PointId id : ids) points += std::binary_search(holding.begin(), holding.end(), id) ? 1 : 0;
    }
    if (points > 0) result.push_back({handle, points});
  };
  for (std::size_t h = 0; h < regions.handles.size(); ++h) count(regions.handles[h], h);
  count(regions.fixed, ConstraintReport::Held::fixed);
  return result;
}

}  // namespace

MirroredConstraints::MirroredConstraints(const Setup& half, const Mesh& mesh, const SelectedRegions& regions,
                                         const MirroredMesh& mirrored)
    : mirrored_(&mirrored) {
  if (half.constraints.empty()) return;
  const Box box = bounding_box(mesh.points);
  const UnitMap units = units_ = {box.min, box.diagonal()};
  // As constraints of the half model, whose indices messages name.
  Problems problems(Problems::Mode::throw_first);
  check_constraint_sets(mesh, half, regions, {units.origin, units.scale}, problems);
  const Symmetry& symmetry = regions.symmetry;
  for (std::size_t i = 0; i < half.constraints.size(); ++i) {
    const Constraint& constraint = half.constraints[i];
    const Places& own = regions.constraints[i];
    const auto* rigid = std::get_if<Rigid>(&constraint.kind);
    // Columns of cells are rigid one by one, so that one constraint has those of all images.
    const bool columns = rigid != nullptr && rigid->layers > 0;
    const std::size_t planes =
        columns ? mirrored.images() - 1
                : continued_planes(constraint, own, symmetry, mirrored, units, "constraints[" + std::to_string(i) + "]");
    add_set(constraint, own, symmetry, planes, columns);
    if (!columns) sets_.back().held = held_points(own, regions);
    for (std::size_t g = 0; g < mirrored.images(); ++g) {
      if ((g & planes) != 0) continue;
      Constraint& copy = constraints.emplace_back(constraint);
      constraint_of.push_back(i);
      if (g != 0) copy.name += " (image " + std::to_string(g) + ")";
      copy.kind = mirrored_kind(constraint.kind, mirrored, g);
      copy.regions = regions_of(images_of(own, symmetry, mirrored, g, planes));
    }
    for (std::size_t k = 0; k < symmetry.planes() && mirroring_of(constraint.kind) == Mirroring::shape; ++k) {
      if ((planes >> k & 1u) == 0) continue;
      notes.push_back("Constraint " + constraint.name + " continues through symmetry[" + std::to_string(k) +
                      "]: its points and their mirror images are on one shape.");
    }
  }
}

void MirroredConstraints::add_set(const Constraint& constraint, const std::vector<std::vector<PointId>>& regions,
                                  const Symmetry& symmetry, std::size_t planes, bool columns) {
  Set& set = sets_.emplace_back();
  set.exact = constraint.exact;
  if (columns) return;
  std::vector<std::vector<Vec3>> rest;
  for (const std::vector<PointId>& ids : regions) {
    std::vector<Vec3>& places = rest.emplace_back();
    for (std::size_t g = 0; g < mirrored_->images(); ++g) {
      if ((g & ~planes) != 0) continue;
      for (const PointId id : ids) {
        if ((symmetry.on(id) & g) != 0) continue;
        set.places.push_back({id, g});
        places.push_back((mirrored_->mesh()->points[mirrored_->image(id, g)] - units_.origin) / units_.scale);
      }
    }
  }
  set.projection = make_projection(constraint.kind, rest, units_, constraint.name);
}

std::vector<ConstraintReport> MirroredConstraints::reports(std::span<const ConstraintReport> whole,
                                                           const std::function<Vec3(PointId)>& place_of) const {
  if (whole.empty()) return {};
  std::vector<ConstraintReport> result(constraint_of.empty() ? 0 : constraint_of.back() + 1);
  std::vector<double> copies(result.size());
  for (std::size_t c = 0; c < whole.size(); ++c) {
    ConstraintReport& report = result[constraint_of[c]];
    report.max_before = std::max(report.max_before, whole[c].max_before);
    report.max = std::max(report.max, whole[c].max);
    report.rms_before += whole[c].rms_before * whole[c].rms_before;
    report.rms += whole[c].rms * whole[c].rms;
    report.missed = report.missed || whole[c].missed;
    report.given_up = report.given_up || whole[c].given_up;
    if (!whole[c].held.empty()) report.held = sets_[constraint_of[c]].held;
    if (whole[c].held_misfit) {
      if (!report.held_misfit) report.held_misfit.emplace();
      report.held_misfit->max = std::max(report.held_misfit->max, whole[c].held_misfit->max);
      report.held_misfit->rms += whole[c].held_misfit->rms * whole[c].held_misfit->rms;
    }
    merge(whole[c].heights, report.heights);
    merge(whole[c].heights_before, report.heights_before);
    ++copies[constraint_of[c]];
  }
  for (std::size_t i = 0; i < result.size(); ++i) {
    result[i].rms_before = std::sqrt(result[i].rms_before / copies[i]);
    result[i].rms = std::sqrt(result[i].rms / copies[i]);
    if (result[i].held_misfit) result[i].held_misfit->rms = std::sqrt(result[i].held_misfit->rms / copies[i]);
    const Set& set = sets_[i];
    if (set.projection == nullptr) continue;
    std::vector<Vec3> x, onto(set.places.size());
    for (const Set::Place& place : set.places) {
      x.push_back((mirrored_->reflected_point(place_of(place.id), place.image) - units_.origin) / units_.scale);
    }
    ShapeParameters shape;
    set.projection->project(x, onto, shape);
    const Projection::Misfit misfit = set.projection->misfit(x, onto);
    result[i].max = units_.scale * misfit.largest;
    result[i].rms = units_.scale * std::sqrt(misfit.squares / static_cast<double>(std::max<std::size_t>(1, misfit.count)));
    result[i].missed = result[i].missed || (set.exact && !result[i].given_up && misfit.largest > exact_distance);
  }
  return result;
}

}  // namespace deform
