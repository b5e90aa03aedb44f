// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/rbf/centres.h"

#include <algorithm>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "core/mesh/adjacency.h"

namespace deform {

namespace {

// Points in the components of the deformable region that a constraint point can be reached from.
bool every_component_is_held(const Adjacency& adjacency, const ConstraintPoints& points) {
  std::vector<char> held(points.region_of.size());
  for (std::size_t i = 0; i < held.size(); ++i) held[i] = points.region_of[i] != deformable_region;
  const std::vector<char> reached = adjacency.grow(held, -1);
  return std::all_of(points.deformable.begin(), points.deformable.end(), [&](PointId id) { return reached[id] != 0; });
}

// The centres within the rings, or the reason why all of them are needed.
std::string reduce(const Mesh& mesh, const RbfOptions& options, std::size_t handles, const ConstraintPoints& points,
                   std::vector<PointId>& kept) {
  if (points.deformable.empty()) return "no point is deformable";
  if (mesh.face_count() == 0) return "the geometry has no faces";
  const Adjacency adjacency(mesh);
  const auto loose = std::count_if(points.deformable.begin(), points.deformable.end(),
                                   [&](PointId id) { return adjacency.faces_of(id).empty(); });
  if (loose > 0) return "no face holds " + std::to_string(loose) + " of the deformable points (the inside of a volume)";
  std::vector<char> deformable(mesh.point_count());
  for (const PointId id : points.deformable) deformable[id] = 1;
  const std::vector<char> near = adjacency.grow(deformable, options.reduction_rings);
  const std::vector<char> defects = adjacency.non_manifold_points();
  std::size_t bad = 0;
  PointId first = 0;
  for (std::size_t i = mesh.point_count(); i-- > 0;) {
    if (near[i] && defects[i]) {
      ++bad;
      first = static_cast<PointId>(i);
    }
  }
  if (bad != 0) {
    return "the mesh is not manifold at " + std::to_string(bad) + " points near the deformable region, the first is point " +
           std::to_string(first);
  }
  if (!every_component_is_held(adjacency, points)) return "a component of the mesh has no handle and no fixed point";
  std::vector<char> seen(handles);
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    const RegionIndex region = points.region_of[i];
    if (!near[i] || region == deformable_region) continue;
    kept.push_back(static_cast<PointId>(i));
    if (region < handles) seen[region] = 1;
  }
  if (std::find(seen.begin(), seen.end(), 0) != seen.end()) return "a handle lies farther away from the deformable region";
  return {};
}

// All points of a place must move alike, so the first candidate there stands for it.
void keep_one_per_place(const ConstraintPoints& points, const std::vector<PointId>& candidates, RbfCentres& centres) {
  std::unordered_map<PointId, PointId> first_of;
  for (const auto& cluster : points.coincident) {
    for (const PointId id : cluster) first_of[id] = cluster.front();
  }
  std::unordered_set<PointId> taken;
  for (const PointId id : candidates) {
    const auto found = first_of.find(id);
    if (taken.insert(found == first_of.end() ? id : found->second).second) {
      centres.ids.push_back(id);
    } else {
      ++centres.merged;
    }
  }
}

}  // namespace

RbfCentres choose_centres(const Mesh& mesh, const ConstraintPoints& points, std::size_t handles, const RbfOptions& options) {
  RbfCentres centres;
  std::vector<PointId> candidates;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    if (points.region_of[i] != deformable_region) candidates.push_back(static_cast<PointId>(i));
  }
  if (options.reduction == CentreReduction::automatic) {
    std::vector<PointId> kept;
    const std::string reason = reduce(mesh, options, handles, points, kept);
    const std::string rings = std::to_string(options.reduction_rings) + " rings around the deformable region";
    if (!reason.empty()) {
      centres.notes.push_back("All " + std::to_string(candidates.size()) + " constraint points are centres, not only " + rings +
                              ": " + reason + ".");
    } else if (kept.size() < candidates.size()) {
      centres.notes.push_back(std::to_string(kept.size()) + " of " + std::to_string(candidates.size()) +
                              " constraint points are centres: those within " + rings + ".");
      centres.reduced = true;
      candidates = std::move(kept);
    }
  }
  keep_one_per_place(points, candidates, centres);
  if (centres.merged != 0) {
    centres.notes.push_back(std::to_string(centres.merged) + " coincident constraint points were merged with others.");
  }
  return centres;
}

}  // namespace deform
