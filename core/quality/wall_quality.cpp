// SPDX-License-Identifier: Apache-2.0
#include "core/quality/wall_quality.h"

#include <algorithm>
#include <limits>
#include <map>
#include <numbers>
#include <string>
#include <unordered_map>
#include <vector>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/quality/boundary_owners.h"
#include "core/quality/infinity.h"
#include "core/quality/polygon.h"

namespace deform {

namespace {

using namespace quality;

/// A cell of the first layer by its edges; every end of an edge is a point of the cell.
using Edges = std::vector<std::pair<PointId, PointId>>;

/// Wall faces of the same side of a cell: one, or those around the mid-face node of a quadratic element.
struct Side {
  FaceId face = 0;             ///< the first
  std::vector<PointId> nodes;  ///< of all
  Vec3 area{};
};

class FirstLayer {
 public:
  FirstLayer(const Wall& wall, std::vector<BoundaryOwner> owners)
      : wall_(wall), owners_(std::move(owners)), offsets_(wall.mesh.face_offsets()), on_wall_(wall.mesh.point_count()) {
    if (wall.faces.empty()) throw Error(ErrorCode::invalid_argument, "the wall has no faces");
    check_ids(wall.faces, wall.mesh.face_count(), "wall", "face");
    for (const FaceId face : wall.faces) {
      for (const PointId p : corners(face)) on_wall_[p] = 1;
    }
    normal_.assign(on_wall_.size(), Vec3{});
    angle_.assign(on_wall_.size(), infinity);
    for (const FaceId f : wall.faces) {
      const Vec3 inward = -1.0 * vector_area(wall.mesh.points, corners(f));
      for (const PointId p : corners(f)) normal_[p] = normal_[p] + inward;
    }
    result_.least_height.value = result_.least_angle.value = infinity;
    result_.largest_height.value = result_.largest_angle.value = -infinity;
  }

  const std::vector<BoundaryOwner>& owners() const { return owners_; }

  /// Calls use(cell, side) for every side that is wall, in the order of the first faces.
  template <typename Use>
  void for_each_side(const Use& use) const {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::size_t> numbers;
    std::vector<Side> sides;
    for (const FaceId f : wall_.faces) {
      const auto [entry, added] = numbers.try_emplace({owners_[f].cell, owners_[f].side}, sides.size());
      if (added) sides.push_back({f, {}, {}});
      Side& side = sides[entry->second];
      side.nodes.insert(side.nodes.end(), corners(f).begin(), corners(f).end());
      side.area = side.area + vector_area(wall_.mesh.points, corners(f));
    }
    for (const Side& side : sides) use(owners_[side.face].cell, side);
  }

  void add(const Side& side, double volume, const Edges& cell) {
    for (const auto& [a, b] : cell) {
      if (on_wall_[a] && !on_wall_[b]) see_edge(a, b);
      if (on_wall_[b] && !on_wall_[a]) see_edge(b, a);
    }
    const double area = length(side.area);
    if (!(area > 0)) return;
    const double height = (is_cone(side.nodes, cell) ? 3 : 1) * volume / area;
    ++result_.faces;
    sum_ += height;
    if (height < result_.least_height.value) result_.least_height = {height, side.face};
    if (height > result_.largest_height.value) result_.largest_height = {height, side.face};
  }

  WallQuality finish() {
    if (result_.faces == 0) throw Error(ErrorCode::invalid_argument, "no face of the wall has an area");
    result_.average_height = sum_ / static_cast<double>(result_.faces);
    double sum = 0;
    for (std::size_t p = 0; p < angle_.size(); ++p) {
      if (angle_[p] == infinity) continue;
      const double degrees = angle_[p] * 180 / std::numbers::pi;
      ++result_.points;
      sum += degrees;
      if (degrees < result_.least_angle.value) result_.least_angle = {degrees, p};
      if (degrees > result_.largest_angle.value) result_.largest_angle = {degrees, p};
    }
    if (result_.points == 0) {
      result_.least_angle = result_.largest_angle = {};
    } else {
      result_.average_angle = sum / static_cast<double>(result_.points);
    }
    return result_;
  }

 private:
  std::span<const PointId> corners(FaceId face) const {
    return std::span(wall_.mesh.face_points).subspan(offsets_[face], wall_.mesh.face_sizes[face]);
  }

  void see_edge(PointId from, PointId to) {
    const Vec3 edge = wall_.mesh.points[to] - wall_.mesh.points[from];
    if (length(edge) > 0 && length(normal_[from]) > 0) angle_[from] = std::min(angle_[from], angle_between(normal_[from], edge));
  }

  /// Whether the cell has exactly one corner off the side.
  static bool is_cone(std::span<const PointId> side, const Edges& cell) {
    const auto off = [&](PointId p) { return std::find(side.begin(), side.end(), p) == side.end(); };
    PointId apex = 0;
    bool found = false;
    for (const auto& [a, b] : cell) {
      for (const PointId p : {a, b}) {
        if (!off(p)) continue;
        if (found && p != apex) return false;
        apex = p;
        found = true;
      }
    }
    return found;
  }

  const Wall& wall_;
  const std::vector<BoundaryOwner> owners_;
  const std::vector<std::uint64_t> offsets_;
  std::vector<char> on_wall_;
  std::vector<Vec3> normal_;
  std::vector<double> angle_;  // least at a point so far, radians
  WallQuality result_;
  double sum_ = 0;
};

void check_volumes(const Wall& wall, std::size_t cells) {
  if (wall.volumes.size() == cells) return;
  throw Error(ErrorCode::invalid_argument,
              std::to_string(wall.volumes.size()) + " volumes, the mesh has " + std::to_string(cells) + " cells");
}

/// The edges of the cells that own wall faces.
std::unordered_map<std::uint32_t, Edges> edges_of_owners(const Wall& wall, const PolyhedralCells& cells,
                                                         const std::vector<BoundaryOwner>& owners) {
  std::unordered_map<std::uint32_t, Edges> edges;
  std::vector<char> wanted(cells.cell_count);
  for (const FaceId f : wall.faces) wanted[owners[f].cell] = 1;
  for (std::size_t f = 0; f < cells.face_count(); ++f) {
    const auto add = [&](std::uint32_t cell) {
      if (!wanted[cell]) return;
      const auto corners = cells.face(f);
      for (std::size_t c = 0; c < corners.size(); ++c) {
        edges[cell].emplace_back(corners[c], corners[c + 1 == corners.size() ? 0 : c + 1]);
      }
    };
    add(cells.owner[f]);
    if (f < cells.internal_faces()) add(cells.neighbour[f]);
  }
  return edges;
}

}  // namespace

WallQuality wall_quality(const Wall& wall, const PolyhedralCells& cells, const RunContext& context) {
  check_volumes(wall, cells.cell_count);
  FirstLayer layer(wall, boundary_owners(wall.mesh, cells));
  context.check();
  const auto edges = edges_of_owners(wall, cells, layer.owners());
  context.check();
  layer.for_each_side([&](std::uint32_t cell, const Side& side) { layer.add(side, wall.volumes[cell], edges.at(cell)); });
  WallQuality result = layer.finish();
  for (Extreme* height : {&result.least_height, &result.largest_height}) height->id += cells.internal_faces();
  return result;
}

WallQuality wall_quality(const Wall& wall, const Elements& elements, const RunContext& context) {
  check_volumes(wall, elements.size());
  FirstLayer layer(wall, boundary_owners(wall.mesh, elements));
  context.check();
  Edges edges;
  layer.for_each_side([&](std::uint32_t e, const Side& side) {
    const auto nodes = elements.nodes(e);
    edges.clear();
    for (const auto& edge : shape(elements.types[e]).edges) edges.emplace_back(nodes[edge[0]], nodes[edge[1]]);
    layer.add(side, wall.volumes[e], edges);
  });
  return layer.finish();
}

}  // namespace deform
