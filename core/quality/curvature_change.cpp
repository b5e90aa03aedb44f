// SPDX-License-Identifier: Apache-2.0
#include "core/quality/curvature_change.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "core/base/error.h"

namespace deform {

namespace {

/// The edges of the faces, each once, ends ascending.
std::vector<std::pair<PointId, PointId>> edges_of_faces(const Mesh& mesh) {
  std::vector<std::pair<PointId, PointId>> edges;
  edges.reserve(mesh.face_points.size());
  std::size_t first = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    for (std::size_t c = 0; c < size && size > 1; ++c) {
      const PointId a = mesh.face_points[first + c], b = mesh.face_points[first + (c + 1 == size ? 0 : c + 1)];
      if (a != b) edges.emplace_back(std::min(a, b), std::max(a, b));
    }
    first += size;
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
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
  for (std::size_t i = 0; i < n; ++i) {
    const double change = after.value[i] - before.value[i];
    result.value.push_back(change);
    if (std::abs(change) > std::abs(result.largest.value)) result.largest = {change, i};
  }
  std::vector<double> sum(n);
  std::vector<std::size_t> neighbours(n);
  for (const auto& [a, b] : edges_of_faces(mesh)) {
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
