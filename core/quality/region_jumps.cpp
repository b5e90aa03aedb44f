// SPDX-License-Identifier: Apache-2.0
#include "core/quality/region_jumps.h"

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/mesh/adjacency.h"
#include "core/mesh/edge_uses.h"
#include "core/quality/polygon.h"

namespace deform {

namespace {

using namespace quality;

constexpr std::size_t points_per_range = 4096;

struct Jump {
  PointId point = 0;
  double normal = 0, curvature = 0;
};

void raise(Extreme& largest, double value, PointId point) {
  if (value > largest.value) largest = {value, point};
}

class Borders {
 public:
  Borders(const Mesh& mesh, std::span<const std::uint32_t> labels, const MeanCurvature& curvature)
      : mesh_(mesh), labels_(labels), curvature_(curvature), adjacency_(mesh) {}

  /// Appends the jumps at the border edges from a point to points of higher number; `edges` is memory to work with.
  void append(PointId point, std::vector<EdgeUse>& edges, std::vector<Jump>& jumps) const {
    edge_uses(adjacency_, point, edges);
    for (const EdgeUse& edge : edges) {
      if (edge.other < point || labels_[edge.other] == labels_[point]) continue;
      jumps.push_back({point, angle_between(side(point), side(edge.other)) * 180 / std::numbers::pi,
                       std::abs(curvature_.value[point] - curvature_.value[edge.other])});
    }
  }

 private:
  Vec3 side(PointId point) const {
    Vec3 own{}, all{};
    bool any = false;
    for (const FaceId f : adjacency_.faces_of(point)) {
      const auto corners = adjacency_.points_of(f);
      const Vec3 area = vector_area(mesh_.points, corners);
      all = all + area;
      if (!std::all_of(corners.begin(), corners.end(), [&](PointId p) { return labels_[p] == labels_[point]; })) continue;
      own = own + area;
      any = true;
    }
    return any ? own : all;
  }

  const Mesh& mesh_;
  const std::span<const std::uint32_t> labels_;
  const MeanCurvature& curvature_;
  const Adjacency adjacency_;
};

}  // namespace

RegionJumps region_jumps(const Mesh& mesh, std::span<const std::uint32_t> labels, const MeanCurvature& curvature,
                         const RunContext& context) {
  const std::size_t n = mesh.point_count();
  if (labels.size() != n || curvature.value.size() != n) {
    throw Error(ErrorCode::invalid_argument, std::to_string(labels.size()) + " labels and " +
                                                 std::to_string(curvature.value.size()) + " curvatures, the mesh has " +
                                                 std::to_string(n) + " points");
  }
  const Borders borders(mesh, labels, curvature);
  std::vector<std::vector<Jump>> blocks((n + points_per_range - 1) / points_per_range);
  parallel_for(context, n, points_per_range, [&](std::size_t begin, std::size_t end) {
    std::vector<EdgeUse> edges;
    for (std::size_t i = begin; i < end; ++i) borders.append(static_cast<PointId>(i), edges, blocks[begin / points_per_range]);
  });
  RegionJumps result;
  double normals = 0, curvatures = 0;
  for (const auto& block : blocks) {
    for (const Jump& jump : block) {
      result.points.push_back(jump.point);
      result.normal_jumps.push_back(jump.normal);
      result.curvature_jumps.push_back(jump.curvature);
      normals += jump.normal * jump.normal;
      raise(result.largest_normal_jump, jump.normal, jump.point);
      if (std::isnan(jump.curvature)) continue;
      ++result.curvature_edges;
      curvatures += jump.curvature * jump.curvature;
      raise(result.largest_curvature_jump, jump.curvature, jump.point);
    }
  }
  result.edges = result.points.size();
  if (result.edges > 0) result.rms_normal_jump = std::sqrt(normals / static_cast<double>(result.edges));
  if (result.curvature_edges > 0) {
    result.rms_curvature_jump = std::sqrt(curvatures / static_cast<double>(result.curvature_edges));
  }
  return result;
}

JumpGrowth jump_growth(const RegionJumps& after, const RegionJumps& before) {
  if (after.edges != before.edges) {
    throw Error(ErrorCode::invalid_argument,
                std::to_string(after.edges) + " border edges, before there were " + std::to_string(before.edges));
  }
  JumpGrowth growth;
  for (std::size_t i = 0; i < after.edges; ++i) {
    raise(growth.normal, after.normal_jumps[i] - before.normal_jumps[i], after.points[i]);
    raise(growth.curvature, after.curvature_jumps[i] - before.curvature_jumps[i], after.points[i]);
  }
  return growth;
}

}  // namespace deform
