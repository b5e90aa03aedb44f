// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/inspect.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/base/vectors.h"
#include "core/mesh/adjacency.h"
#include "core/mesh/edge_uses.h"

namespace deform {

namespace {

/// Length of the vector area, exact for plane polygons.
double area(const Mesh& mesh, std::span<const PointId> corners) {
  Vec3 twice{0, 0, 0};
  const Vec3& origin = mesh.points[corners[0]];
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
    twice = twice + cross(mesh.points[corners[i]] - origin, mesh.points[corners[i + 1]] - origin);
  }
  return 0.5 * norm(twice);
}

bool repeats_a_corner(std::span<const PointId> corners) {
  std::vector<PointId> sorted(corners.begin(), corners.end());
  std::sort(sorted.begin(), sorted.end());
  return std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end();
}

void count_faces(const Mesh& mesh, const Adjacency& adjacency, MeshReport& report) {
  const double diagonal = report.box.diagonal();
  for (std::size_t face = 0; face < mesh.face_count(); ++face) {
    const std::uint32_t size = mesh.face_sizes[face];
    ++(size == 3 ? report.triangles : size == 4 ? report.quads : report.other_faces);
    const auto corners = adjacency.points_of(static_cast<FaceId>(face));
    const bool sound =
        size >= 3 && !repeats_a_corner(corners) && area(mesh, corners) >= least_area(mesh.points, corners, diagonal);
    if (!sound) ++report.degenerate_faces;
  }
}

void count_edges(const Mesh& mesh, const Adjacency& adjacency, MeshReport& report) {
  std::vector<EdgeUse> edges;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    edge_uses(adjacency, static_cast<PointId>(i), edges);
    for (const EdgeUse& edge : edges) {
      if (edge.other < i) continue;  // seen from the other end
      ++report.edges;
      report.boundary_edges += edge.faces() == 1;
      report.non_manifold_edges += edge.faces() > 2;
      report.inconsistent_edges += edge.faces() == 2 && edge.outgoing != 1;
    }
  }
}

std::size_t count_components(const Mesh& mesh, const Adjacency& adjacency) {
  std::vector<PointId> parent(mesh.point_count());
  std::iota(parent.begin(), parent.end(), PointId{0});
  const auto root = [&parent](PointId i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  for (std::size_t face = 0; face < mesh.face_count(); ++face) {
    const auto corners = adjacency.points_of(static_cast<FaceId>(face));
    for (const PointId corner : corners) parent[root(corner)] = root(corners[0]);
  }
  std::size_t components = 0;
  for (std::size_t i = 0; i < parent.size(); ++i) {
    components += parent[i] == i && !adjacency.faces_of(static_cast<PointId>(i)).empty();
  }
  return components;
}

}  // namespace

std::vector<PointId> coincident_points(std::span<const Vec3> points) {
  std::vector<PointId> order(points.size());
  std::iota(order.begin(), order.end(), PointId{0});
  std::sort(order.begin(), order.end(),
            [&](PointId s, PointId t) { return points[s] != points[t] ? points[s] < points[t] : s < t; });
  std::vector<PointId> same(points.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    same[order[i]] = i > 0 && points[order[i]] == points[order[i - 1]] ? same[order[i - 1]] : order[i];
  }
  return same;
}

std::vector<std::size_t> group_point_counts(const Mesh& mesh) {
  std::vector<std::size_t> counts;
  if (mesh.groups.empty()) return counts;
  std::vector<std::size_t> seen_in(mesh.point_count(), 0);  // number of the last group, from 1
  const auto offsets = mesh.face_offsets();
  for (std::size_t g = 0; g < mesh.groups.size(); ++g) {
    std::size_t points = 0;
    const auto see = [&](PointId point) {
      points += seen_in[point] != g + 1;
      seen_in[point] = g + 1;
    };
    for (const PointId point : mesh.groups[g].points) see(point);
    for (const FaceId face : mesh.groups[g].faces) {
      for (auto corner = offsets[face]; corner < offsets[face + 1]; ++corner) see(mesh.face_points[corner]);
    }
    counts.push_back(points);
  }
  return counts;
}

double least_area(std::span<const Vec3> points, std::span<const PointId> corners, double diagonal) {
  constexpr double relative_area = 1e-12, rounding = std::numeric_limits<double>::epsilon();
  double longest = 0;
  for (std::size_t c = 0; c < corners.size(); ++c) {
    longest = std::max(longest, norm(points[corners[(c + 1) % corners.size()]] - points[corners[c]]));
  }
  return std::max({relative_area * longest * longest, rounding * diagonal * longest, std::numeric_limits<double>::min()});
}

MeshReport inspect(const Mesh& mesh) {
  const Adjacency adjacency(mesh);
  MeshReport report;
  report.points = mesh.point_count();
  report.faces = mesh.face_count();
  report.corners = mesh.face_points.size();
  report.box = bounding_box(mesh.points);
  count_faces(mesh, adjacency, report);
  count_edges(mesh, adjacency, report);
  report.components = count_components(mesh, adjacency);
  const std::vector<char> non_manifold = adjacency.non_manifold_points();
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    const bool isolated = adjacency.faces_of(static_cast<PointId>(i)).empty();
    report.isolated_points += isolated;
    report.non_manifold_points += non_manifold[i] && !isolated;
  }
  const std::vector<PointId> same = coincident_points(mesh.points);
  for (std::size_t i = 0; i < same.size(); ++i) report.coincident_points += same[i] != i;
  const auto group_points = group_point_counts(mesh);
  for (std::size_t g = 0; g < mesh.groups.size(); ++g) {
    report.groups.push_back({mesh.groups[g].name, group_points[g], mesh.groups[g].faces.size()});
  }
  return report;
}

}  // namespace deform
