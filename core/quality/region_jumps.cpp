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

constexpr std::size_t grain = 4096;

/// The jumps at the border edges from a point to points of higher number.
struct PointJumps {
  std::uint32_t edges = 0, curvature_edges = 0;
  double largest_normal = 0, normal_squares = 0;
  double largest_curvature = 0, curvature_squares = 0;
};

class Borders {
 public:
  Borders(const Mesh& mesh, std::span<const std::uint32_t> labels, const MeanCurvature& curvature)
      : mesh_(mesh), labels_(labels), curvature_(curvature), adjacency_(mesh) {}

  PointJumps at(PointId point, std::vector<EdgeUse>& edges) const {
    PointJumps jumps;
    edge_uses(adjacency_, point, edges);
    for (const EdgeUse& edge : edges) {
      if (edge.other < point || labels_[edge.other] == labels_[point]) continue;
      ++jumps.edges;
      const double degrees = angle_between(side(point), side(edge.other)) * 180 / std::numbers::pi;
      jumps.largest_normal = std::max(jumps.largest_normal, degrees);
      jumps.normal_squares += degrees * degrees;
      if (!curvature_.defined(point) || !curvature_.defined(edge.other)) continue;
      ++jumps.curvature_edges;
      const double difference = std::abs(curvature_.value[point] - curvature_.value[edge.other]);
      jumps.largest_curvature = std::max(jumps.largest_curvature, difference);
      jumps.curvature_squares += difference * difference;
    }
    return jumps;
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
  std::vector<PointJumps> all(n);
  parallel_for(context, n, grain, [&](std::size_t begin, std::size_t end) {
    std::vector<EdgeUse> edges;
    for (std::size_t i = begin; i < end; ++i) all[i] = borders.at(static_cast<PointId>(i), edges);
  });
  RegionJumps result;
  double normals = 0, curvatures = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const PointJumps& jumps = all[i];
    result.edges += jumps.edges;
    result.curvature_edges += jumps.curvature_edges;
    normals += jumps.normal_squares;
    curvatures += jumps.curvature_squares;
    if (jumps.largest_normal > result.largest_normal_jump.value) result.largest_normal_jump = {jumps.largest_normal, i};
    if (jumps.largest_curvature > result.largest_curvature_jump.value) {
      result.largest_curvature_jump = {jumps.largest_curvature, i};
    }
  }
  if (result.edges > 0) result.rms_normal_jump = std::sqrt(normals / static_cast<double>(result.edges));
  if (result.curvature_edges > 0) {
    result.rms_curvature_jump = std::sqrt(curvatures / static_cast<double>(result.curvature_edges));
  }
  return result;
}

}  // namespace deform
