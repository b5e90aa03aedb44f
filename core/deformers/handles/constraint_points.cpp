// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/constraint_points.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <span>
#include <unordered_map>
#include <utility>

#include "core/mesh/cells.h"
#include "core/mesh/elements.h"

namespace deform {

namespace {

constexpr double coincidence = 1e-12;  // of the diagonal
constexpr std::size_t points_per_check = 4096;

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
  Coincidence(const Mesh& mesh, const Vec3& origin, double tolerance, std::size_t count)
      : mesh_(mesh), origin_(origin), tolerance_(tolerance), cell_(16 * tolerance), next_(mesh.point_count(), none) {
    newest_.reserve(count);
  }

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
          const auto found = newest_.find({x, y, z});
          for (PointId other = found == newest_.end() ? none : found->second; other != none; other = next_[other]) {
            if (near(mesh_.points[other], point)) best = std::min(best, other);
          }
        }
      }
    }
    if (best == id) {
      const auto at = [&](double x) { return static_cast<std::int64_t>(std::floor(x / cell_)); };
      PointId& newest = newest_.try_emplace({at(p[0]), at(p[1]), at(p[2])}, none).first->second;
      next_[id] = newest;
      newest = id;
    }
    return best;
  }

 private:
  static constexpr PointId none = std::numeric_limits<PointId>::max();

  bool near(const Vec3& a, const Vec3& b) const { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]) <= tolerance_; }

  const Mesh& mesh_;
  Vec3 origin_;
  double tolerance_, cell_;
  std::unordered_map<Cell, PointId, CellHash> newest_;  ///< of each cell; the others follow by next_
  std::vector<PointId> next_;
};

}  // namespace

ConstraintPoints constraint_points(const Mesh& mesh, const SelectedRegions& regions, const RunContext& context) {
  ConstraintPoints result;
  result.region_of.assign(mesh.point_count(), deformable_region);
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    for (const PointId id : regions.handles[h]) result.region_of[id] = static_cast<RegionIndex>(h);
  }
  for (const PointId id : regions.fixed) result.region_of[id] = fixed_region;
  const Box box = bounding_box(mesh.points);
  result.count = static_cast<std::size_t>(std::count_if(result.region_of.begin(), result.region_of.end(),
                                                        [](RegionIndex region) { return region != deformable_region; }));
  Coincidence finder(mesh, box.min, std::max(coincidence * box.diagonal(), 1e-290), result.count);
  std::map<PointId, std::vector<PointId>> clusters;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    if (i % points_per_check == 0) context.check();
    const auto id = static_cast<PointId>(i);
    if (result.region_of[i] == deformable_region) {
      result.deformable.push_back(id);
      continue;
    }
    const PointId first = finder.representative(id);
    if (first != id) clusters[first].push_back(id);
  }
  for (auto& [first, others] : clusters) {
    others.insert(others.begin(), first);
    result.coincident.push_back(std::move(others));
  }
  return result;
}

std::vector<char> next_to_deformable(const Mesh& mesh, const std::vector<RegionIndex>& region_of) {
  std::vector<char> mask(region_of.size());
  const auto deformable = [&](PointId id) { return region_of[id] == deformable_region; };
  const auto mark = [&](std::span<const PointId> points) {
    if (std::none_of(points.begin(), points.end(), deformable)) return;
    for (const PointId id : points) mask[id] = deformable(id) ? 0 : 1;
  };
  std::size_t corner = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    mark(std::span(mesh.face_points).subspan(corner, size));
    corner += size;
  }
  for (std::size_t e = 0; mesh.elements && e < mesh.elements->size(); ++e) mark(mesh.elements->nodes(e));
  for (std::size_t f = 0; mesh.cells && f < mesh.cells->face_count(); ++f) mark(mesh.cells->face(f));
  if (mesh.face_count() == 0 && !mesh.elements && !mesh.cells) {
    for (std::size_t i = 0; i < mask.size(); ++i) mask[i] = deformable(static_cast<PointId>(i)) ? 0 : 1;
  }
  return mask;
}

}  // namespace deform
