// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/unheld_bodies.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>
#include <span>

#include "core/base/vectors.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"

namespace deform {

namespace {

/// Sets of points (Tarjan 1975), each known by its smallest one.
class Sets {
 public:
  explicit Sets(std::size_t points) : parent_(points) { std::iota(parent_.begin(), parent_.end(), PointId{0}); }
  PointId root(PointId i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(PointId a, PointId b) {
    const PointId first = root(a), second = root(b);
    parent_[std::max(first, second)] = std::min(first, second);
  }
  void join(std::span<const PointId> points) {
    for (const PointId point : points) join(points[0], point);
  }

 private:
  std::vector<PointId> parent_;
};

Sets joined_by_faces(const Mesh& mesh) {
  Sets sets(mesh.point_count());
  std::size_t corner = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    sets.join(std::span(mesh.face_points).subspan(corner, size));
    corner += size;
  }
  if (mesh.elements) {
    for (std::size_t e = 0; e < mesh.elements->size(); ++e) sets.join(mesh.elements->nodes(e));
  }
  if (mesh.cells) {
    for (std::size_t f = 0; f < mesh.cells->face_count(); ++f) sets.join(mesh.cells->face(f));
  }
  return sets;
}

void mark(const SelectedRegions& regions, std::vector<char>& held) {
  for (const PointId id : regions.fixed) held[id] = 1;
  for (const auto& handle : regions.handles) {
    for (const PointId id : handle) held[id] = 1;
  }
}

/// Points at one place.
void join_seams(const Points& points, Sets& sets) {
  std::vector<PointId> order(points.size());
  std::iota(order.begin(), order.end(), PointId{0});
  std::sort(order.begin(), order.end(), [&](PointId a, PointId b) { return points[a] < points[b]; });
  for (std::size_t i = 1; i < order.size(); ++i) {
    if (points[order[i]] == points[order[i - 1]]) sets.join(order[i], order[i - 1]);
  }
}

/// "(1, 0.5, 2)"; what is 0 but for rounding is 0.
std::string place_text(const Vec3& place, double diagonal) {
  constexpr double least = 1e-9;
  std::string text;
  for (const double value : place) {
    char digits[32];
    std::snprintf(digits, sizeof digits, "%.3g", std::abs(value) < least * diagonal ? 0.0 : value);
    text += (text.empty() ? "(" : ", ") + std::string(digits);
  }
  return text + ")";
}

}  // namespace

std::vector<UnheldBody> unheld_bodies(const Mesh& mesh, const SelectedRegions& regions) {
  if (mesh.face_count() == 0 && mesh.cell_count() == 0) return {};
  const std::span<const SelectedRegions> stages = regions.stages.empty() ? std::span(&regions, 1) : std::span(regions.stages);
  std::vector<char> held(mesh.point_count(), 0);
  for (const SelectedRegions& stage : stages) {
    if (stage.of != SelectedRegions::Of::mesh_points) return {};
    mark(stage, held);
  }
  Sets sets = joined_by_faces(mesh);
  std::vector<std::uint32_t> size(mesh.point_count(), 0);
  const auto count = [&] {
    std::fill(size.begin(), size.end(), 0);
    std::vector<char> of_set(mesh.point_count(), 0);
    for (std::size_t i = 0; i < held.size(); ++i) {
      const PointId root = sets.root(static_cast<PointId>(i));
      ++size[root];
      of_set[root] = of_set[root] != 0 || held[i] != 0 ? 1 : 0;
    }
    for (std::size_t i = 0; i < size.size(); ++i) {
      if (of_set[i] != 0 || size[i] < 2) size[i] = 0;  // one point alone is no body
    }
    return std::any_of(size.begin(), size.end(), [](std::uint32_t points) { return points > 0; });
  };
  if (!count()) return {};
  join_seams(mesh.points, sets);
  if (!count()) return {};
  std::vector<UnheldBody> bodies;
  std::vector<std::uint32_t> which(mesh.point_count(), std::numeric_limits<std::uint32_t>::max());
  for (std::size_t i = 0; i < size.size(); ++i) {
    const PointId root = sets.root(static_cast<PointId>(i));
    if (size[root] == 0) continue;
    if (root == i) {
      which[i] = static_cast<std::uint32_t>(bodies.size());
      bodies.push_back({size[i], root, {}});
    }
    UnheldBody& body = bodies[which[root]];
    body.centre = body.centre + mesh.points[i] / static_cast<double>(body.points);
  }
  return bodies;
}

std::string unheld_bodies_note(const Mesh& mesh, const SelectedRegions& regions) {
  const std::vector<UnheldBody> bodies = unheld_bodies(mesh, regions);
  if (bodies.empty()) return {};
  const auto largest = std::max_element(bodies.begin(), bodies.end(),
                                        [](const UnheldBody& a, const UnheldBody& b) { return a.points < b.points; });
  const std::string place = std::to_string(largest->points) + " points around " +
                            place_text(largest->centre, bounding_box(mesh.points).diagonal()) + ", from point " +
                            std::to_string(largest->first) + " on";
  const bool one = bodies.size() == 1;
  return (one ? "A body of " + place + ", has" : std::to_string(bodies.size()) + " bodies, the largest of " + place + ", have") +
         " no point in a handle or fixed region: rbf moves " + (one ? "it" : "them") +
         " with the space around, energies hardly determine " + (one ? "it" : "them") + "; make " + (one ? "it" : "each") +
         " part of a handle or fixed region.";
}

}  // namespace deform
