// SPDX-License-Identifier: Apache-2.0
#include "core/quality/curvature_change.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <string>
#include <tuple>
#include <utility>

#include "core/base/error.h"
#include "core/quality/polygon.h"

namespace deform {

namespace {

using PointPair = std::pair<PointId, PointId>;

struct EdgeOfFace {
  PointPair ends;  // ascending
  bool ascending;  // the face runs along it from the lower end
  FaceId face;
};

/// The edges of the faces, those between the same points together.
std::vector<EdgeOfFace> edges_of_faces(const Mesh& mesh) {
  std::vector<EdgeOfFace> edges;
  edges.reserve(mesh.face_points.size());
  std::size_t first = 0;
  for (FaceId f = 0; f < mesh.face_count(); ++f) {
    const std::uint32_t size = mesh.face_sizes[f];
    for (std::size_t c = 0; c < size && size > 1; ++c) {
      const PointId a = mesh.face_points[first + c], b = mesh.face_points[first + (c + 1 == size ? 0 : c + 1)];
      if (a != b) edges.push_back({{std::min(a, b), std::max(a, b)}, a < b, f});
    }
    first += size;
  }
  std::sort(edges.begin(), edges.end(),
            [](const EdgeOfFace& a, const EdgeOfFace& b) { return std::tie(a.ends, a.face) < std::tie(b.ends, b.face); });
  return edges;
}

/// Whether the two faces along an edge turn sharply there, however they are oriented.
bool is_sharp(const EdgeOfFace& a, const EdgeOfFace& b, const std::vector<Vec3>& normals) {
  const Vec3 turned = a.ascending == b.ascending ? -1 * normals[b.face] : normals[b.face];
  return quality::angle_between(normals[a.face], turned) > sharp_edge_degrees * std::numbers::pi / 180;
}

void check_size(const MeanCurvature& curvature, const Mesh& mesh, const char* what) {
  if (curvature.value.size() == mesh.point_count() && curvature.area.size() == mesh.point_count()) return;
  throw Error(ErrorCode::invalid_argument, std::string("curvature change: ") + what + " has " +
                                               std::to_string(curvature.value.size()) + " points, expected " +
                                               std::to_string(mesh.point_count()));
}

}  // namespace

CurvatureChange curvature_change(const Mesh& mesh, const MeanCurvature& before, const MeanCurvature& after) {
  check_size(before, mesh, "before");
  check_size(after, mesh, "after");
  CurvatureChange result;
  const std::size_t n = mesh.point_count();
  for (std::size_t i = 0; i < n; ++i) result.value.push_back(after.value[i] - before.value[i]);
  const auto offsets = mesh.face_offsets();
  std::vector<Vec3> normals;
  for (FaceId f = 0; f < mesh.face_count(); ++f) {
    normals.push_back(quality::vector_area(mesh.points, std::span(mesh.face_points).subspan(offsets[f], mesh.face_sizes[f])));
  }
  const std::vector<EdgeOfFace> uses = edges_of_faces(mesh);
  std::vector<PointPair> edges;
  for (std::size_t i = 0; i < uses.size();) {
    std::size_t end = i + 1;
    while (end < uses.size() && uses[end].ends == uses[i].ends) ++end;
    edges.push_back(uses[i].ends);
    if (end == i + 2 && is_sharp(uses[i], uses[i + 1], normals)) {
      for (const PointId p : {uses[i].ends.first, uses[i].ends.second}) {
        result.value[p] = std::numeric_limits<double>::quiet_NaN();
      }
    }
    i = end;
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (std::abs(result.value[i]) > std::abs(result.largest.value)) result.largest = {result.value[i], i};
  }
  std::vector<double> sum(n);
  std::vector<std::size_t> neighbours(n);
  for (const auto& [a, b] : edges) {
    if (std::isnan(result.value[a]) || std::isnan(result.value[b])) continue;
    sum[a] += result.value[b];
    sum[b] += result.value[a];
    ++neighbours[a];
    ++neighbours[b];
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (neighbours[i] == 0) continue;
    const double rest = result.value[i] - sum[i] / static_cast<double>(neighbours[i]);
    result.high_pass_energy += before.area[i] * rest * rest;
    ++result.points;
  }
  return result;
}

}  // namespace deform
