// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/plane_crossings.h"

#include <cstdio>

#include "core/base/vectors.h"
#include "core/deformers/handles/symmetry.h"

namespace deform {

void PlaneCrossings::Found::add(const Found& later) {
  points += later.points;
  if (later.farthest.value > farthest.value) farthest = later.farthest;
}

PlaneCrossings::PlaneCrossings(const Setup& setup, const Mesh& mesh) {
  if (setup.symmetry.empty()) return;
  const Symmetry symmetry(setup.symmetry, mesh);
  const double tolerance = Symmetry::tolerance * bounding_box(mesh.points).diagonal();
  for (std::size_t k = 0; k < symmetry.planes(); ++k) {
    sides_.push_back({symmetry.normal(k), symmetry.coordinates({})[k], symmetry.reach(k) + tolerance});
  }
}

PlaneCrossings::Found PlaneCrossings::in(std::span<const Vec3> points, std::size_t first) const {
  Found found;
  if (sides_.empty()) return found;
  for (std::size_t i = 0; i < points.size(); ++i) {
    double beyond = 0;
    for (const Side& side : sides_) {
      const double coordinate = dot(side.normal, points[i]) + side.offset;
      if (coordinate < -side.limit && -coordinate > beyond) beyond = -coordinate;
    }
    if (beyond == 0) continue;
    ++found.points;
    if (beyond > found.farthest.value) found.farthest = {beyond, first + i};
  }
  return found;
}

std::string crossed_planes_text(const PlaneCrossings::Found& found, std::size_t points) {
  char distance[40];
  std::snprintf(distance, sizeof distance, "%.3g", found.farthest.value);
  return std::to_string(found.points) + " of " + std::to_string(points) + " points crossed a symmetry plane, point " +
         std::to_string(found.farthest.id) + " farthest, by " + distance;
}

}  // namespace deform
