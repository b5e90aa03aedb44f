// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/cages/crossing_triangles.h"

#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

using Corners = std::array<PointId, 3>;

/// Six times the volume of a tetrahedron, over 0 where d is above a, b, c seen counter-clockwise.
double volume(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) { return dot(cross(b - a, c - a), d - a); }

bool passes_through(const Vec3& p, const Vec3& q, const Vec3& a, const Vec3& b, const Vec3& c) {
  if (!(volume(a, b, c, p) * volume(a, b, c, q) < 0)) return false;
  const double u = volume(p, q, a, b), v = volume(p, q, b, c), w = volume(p, q, c, a);
  return (u > 0 && v > 0 && w > 0) || (u < 0 && v < 0 && w < 0);
}

bool has(const Corners& triangle, PointId id) { return std::find(triangle.begin(), triangle.end(), id) != triangle.end(); }

bool edge_passes(const Points& points, const Corners& of, const Corners& through) {
  for (std::size_t k = 0; k < 3; ++k) {
    const PointId p = of[k], q = of[(k + 1) % 3];
    if (has(through, p) || has(through, q)) continue;
    if (passes_through(points[p], points[q], points[through[0]], points[through[1]], points[through[2]])) return true;
  }
  return false;
}

}  // namespace

std::size_t crossing_triangles(const Mesh& mesh) {
  std::vector<Corners> triangles;
  std::vector<Box> boxes;
  std::vector<std::size_t> order;
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    if (mesh.face_sizes[f] != 3) throw Error(ErrorCode::invalid_argument, "face " + std::to_string(f) + " is no triangle");
    const PointId* const corners = mesh.face_points.data() + 3 * f;
    triangles.push_back({corners[0], corners[1], corners[2]});
    Box& box = boxes.emplace_back();
    for (const PointId id : triangles.back()) box.add(mesh.points[id]);
    order.push_back(f);
  }
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return boxes[a].min[0] < boxes[b].min[0]; });
  std::size_t crossing = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const Box& box = boxes[order[i]];
    const Corners& triangle = triangles[order[i]];
    for (std::size_t j = i + 1; j < order.size() && boxes[order[j]].min[0] <= box.max[0]; ++j) {
      const Box& other = boxes[order[j]];
      if (other.min[1] > box.max[1] || box.min[1] > other.max[1] || other.min[2] > box.max[2] || box.min[2] > other.max[2])
        continue;
      const Corners& beside = triangles[order[j]];
      const auto shared = std::count_if(beside.begin(), beside.end(), [&](PointId id) { return has(triangle, id); });
      if (shared > 1) continue;
      if (edge_passes(mesh.points, triangle, beside) || edge_passes(mesh.points, beside, triangle)) ++crossing;
    }
  }
  return crossing;
}

}  // namespace deform
