#include "core/deformers/handles/constraint_points.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_map>
#include <unordered_set>

#include "core/mesh/adjacency.h"

namespace deform {

namespace {

constexpr double coincidence = 1e-12;  // of the diagonal

struct Cell {
  std::int64_t x, y, z;
  bool operator==(const Cell&) const = default;
};
struct CellHash {
  std::size_t operator()(const Cell& c) const {
    std::uint64_t h = static_cast<std::uint64_t>(c.x) * 0x9e3779b97f4a7c15u;
    h = (h ^ (h >> 29)) + static_cast<std::uint64_t>(c.y) * 0xbf58476d1ce4e5b9u;
    h = (h ^ (h >> 31)) + static_cast<std::uint64_t>(c.z) * 0x94d049bb133111ebu;
    return static_cast<std::size_t>(h ^ (h >> 30));
  }
};

// First point of `ids` (ascending) that lies within the tolerance of each one; itself when there is none.
class Coincidence {
 public:
  /// origin keeps cell numbers small for models far from the coordinate origin.
  Coincidence(const Mesh& mesh, const Vec3& origin, double tolerance)
      : mesh_(mesh), origin_(origin), tolerance_(tolerance), cell_(16 * tolerance) {}

  PointId representative(PointId id) {
    const Vec3& point = mesh_.points[id];
    const Vec3 p{point[0] - origin_[0], point[1] - origin_[1], point[2] - origin_[2]};
    // Cells are 16 tolerances wide: a neighbour within the tolerance is in this cell or across one near side.
    const auto low = [&](double x) { return static_cast<std::int64_t>(std::floor((x - tolerance_) / cell_)); };
    const auto high = [&](double x) { return static_cast<std::int64_t>(std::floor((x + tolerance_) / cell_)); };
    PointId best = id;
    for (std::int64_t x = low(p[0]); x <= high(p[0]); ++x) {
      for (std::int64_t y = low(p[1]); y <= high(p[1]); ++y) {
        for (std::int64_t z = low(p[2]); z <= high(p[2]); ++z) {
          const auto found = first_.find({x, y, z});
          if (found == first_.end()) continue;
          for (const PointId other : found->second) {
            if (near(mesh_.points[other], point)) best = std::min(best, other);
          }
        }
      }
    }
    if (best == id) {
      const auto at = [&](double x) { return static_cast<std::int64_t>(std::floor(x / cell_)); };
      first_[{at(p[0]), at(p[1]), at(p[2])}].push_back(id);
    }
    return best;
  }

 private:
  bool near(const Vec3& a, const Vec3& b) const { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]) <= tolerance_; }

  const Mesh& mesh_;
  Vec3 origin_;
  double tolerance_, cell_;
  std::unordered_map<Cell, std::vector<PointId>, CellHash> first_;
};

// Points in the components of the deformable region that a constraint point can be reached from.
bool every_component_is_held(const Adjacency& adjacency, const RbfCentres& centres) {
  std::vector<char> held(centres.region_of.size());
  for (std::size_t i = 0; i < held.size(); ++i) held[i] = centres.region_of[i] != deformable_region;
  const std::vector<char> reached = adjacency.grow(held, -1);
  return std::all_of(centres.deformable.begin(), centres.deformable.end(), [&](PointId id) { return reached[id] != 0; });
}

// The centres within the rings, or the reason why all of them are needed.
std::string reduce(const Mesh& mesh, const RbfOptions& options, std::size_t handles, const RbfCentres& centres,
                   std::vector<PointId>& kept) {
  if (centres.deformable.empty()) return "no point is deformable";
  if (mesh.face_count() == 0) return "the geometry has no faces";
  const Adjacency adjacency(mesh);
  const auto loose = std::count_if(centres.deformable.begin(), centres.deformable.end(),
                                   [&](PointId id) { return adjacency.faces_of(id).empty(); });
  if (loose > 0) return "no face holds " + std::to_string(loose) + " of the deformable points (the inside of a volume)";
  std::vector<char> deformable(mesh.point_count());
  for (const PointId id : centres.deformable) deformable[id] = 1;
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
  if (!every_component_is_held(adjacency, centres)) return "a component of the mesh has no handle and no fixed point";
  std::vector<char> seen(handles);
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    const RegionIndex region = centres.region_of[i];
    if (!near[i] || region == deformable_region) continue;
    kept.push_back(static_cast<PointId>(i));
    if (region < handles) seen[region] = 1;
  }
  if (std::find(seen.begin(), seen.end(), 0) != seen.end()) return "a handle lies farther away from the deformable region";
  return {};
}

void list_coincident(const std::unordered_map<PointId, PointId>& clusters, RbfCentres& centres) {
  std::map<PointId, std::vector<PointId>> members;
  for (const auto& [id, representative] : clusters) members[representative].push_back(id);
  for (auto& [representative, others] : members) {
    std::sort(others.begin(), others.end());
    others.insert(others.begin(), representative);
    centres.coincident.push_back(std::move(others));
  }
}

// All points of a place must move alike, so the first candidate there stands for it.
void keep_one_per_place(const std::unordered_map<PointId, PointId>& clusters, const std::vector<PointId>& candidates,
                        RbfCentres& centres) {
  std::unordered_set<PointId> taken;
  for (const PointId id : candidates) {
    const auto found = clusters.find(id);
    if (taken.insert(found == clusters.end() ? id : found->second).second) {
      centres.ids.push_back(id);
    } else {
      ++centres.merged;
    }
  }
}

}  // namespace

RbfCentres choose_centres(const Mesh& mesh, const SelectedRegions& regions, const RbfOptions& options) {
  RbfCentres centres;
  centres.region_of.assign(mesh.point_count(), deformable_region);
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    for (const PointId id : regions.handles[h]) centres.region_of[id] = static_cast<RegionIndex>(h);
  }
  for (const PointId id : regions.fixed) centres.region_of[id] = fixed_region;
  std::vector<PointId> candidates;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    (centres.region_of[i] == deformable_region ? centres.deformable : candidates).push_back(static_cast<PointId>(i));
  }
  centres.constraint_points = candidates.size();

  const Box box = bounding_box(mesh.points);
  Coincidence finder(mesh, box.min, std::max(coincidence * box.diagonal(), 1e-290));
  std::unordered_map<PointId, PointId> clusters;  // point -> smallest id at its place, where that is another
  for (const PointId id : candidates) {
    const PointId representative = finder.representative(id);
    if (representative != id) clusters[id] = representative;
  }
  list_coincident(clusters, centres);

  if (options.reduction == CentreReduction::automatic) {
    std::vector<PointId> kept;
    const std::string reason = reduce(mesh, options, regions.handles.size(), centres, kept);
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

  keep_one_per_place(clusters, candidates, centres);
  if (centres.merged != 0) {
    centres.notes.push_back(std::to_string(centres.merged) + " coincident constraint points were merged with others.");
  }
  return centres;
}

}  // namespace deform
