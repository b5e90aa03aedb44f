// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/refined.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <tuple>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/base/error.h"

namespace deform::bench {

namespace {

std::uint64_t key(PointId a, PointId b) { return (static_cast<std::uint64_t>(std::min(a, b)) << 32) | std::max(a, b); }

struct Edge {
  double square = 0;
  PointId a = 0, b = 0;
  bool operator<(const Edge& other) const { return std::tuple(-square, a, b) < std::tuple(-other.square, other.a, other.b); }
};

std::vector<Edge> edges_of(const Mesh& mesh) {
  std::vector<std::uint64_t> keys;
  for (std::size_t c = 0; c < mesh.face_points.size(); ++c) {
    keys.push_back(key(mesh.face_points[c], mesh.face_points[c % 3 == 2 ? c - 2 : c + 1]));
  }
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
  std::vector<Edge> edges;
  for (const std::uint64_t k : keys) {
    Edge edge{0, static_cast<PointId>(k >> 32), static_cast<PointId>(k)};
    for (std::size_t i = 0; i < 3; ++i) {
      const double d = mesh.points[edge.a][i] - mesh.points[edge.b][i];
      edge.square += d * d;
    }
    edges.push_back(edge);
  }
  return edges;
}

/// The triangles of one with some of its edges cut; mids[k]: between corners k and k + 1, or none.
constexpr PointId none = 0xffffffff;
void add_parts(std::array<PointId, 3> p, std::array<PointId, 3> mids, std::vector<PointId>& out) {
  const auto add = [&](PointId a, PointId b, PointId c) { out.insert(out.end(), {a, b, c}); };
  const auto cuts = 3 - std::count(mids.begin(), mids.end(), none);
  if (cuts == 0) return add(p[0], p[1], p[2]);
  // Turned so that the first edge is cut, and of two cut edges the other is the second.
  while (mids[0] == none || (cuts == 2 && mids[1] == none)) {
    std::rotate(p.begin(), p.begin() + 1, p.end());
    std::rotate(mids.begin(), mids.begin() + 1, mids.end());
  }
  if (cuts == 1) {
    add(p[0], mids[0], p[2]);
    add(mids[0], p[1], p[2]);
    return;
  }
  add(mids[0], p[1], mids[1]);
  if (cuts == 2) {
    add(p[0], mids[0], mids[1]);
    add(p[0], mids[1], p[2]);
    return;
  }
  add(p[0], mids[0], mids[2]);
  add(mids[1], p[2], mids[2]);
  add(mids[0], mids[1], mids[2]);
}

void cut(Mesh& mesh, const std::vector<Edge>& edges) {
  std::unordered_map<std::uint64_t, PointId> middle_of;
  middle_of.reserve(2 * edges.size());
  for (const Edge& edge : edges) {
    middle_of.emplace(key(edge.a, edge.b), static_cast<PointId>(mesh.points.size()));
    const Vec3 a = mesh.points[edge.a], b = mesh.points[edge.b];
    mesh.points.push_back({0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])});
  }
  std::vector<PointId> corners;
  std::vector<FaceId> first{0};
  for (std::size_t f = 0; f < mesh.face_sizes.size(); ++f) {
    const std::array<PointId, 3> p{mesh.face_points[3 * f], mesh.face_points[3 * f + 1], mesh.face_points[3 * f + 2]};
    std::array<PointId, 3> mids{none, none, none};
    for (std::size_t k = 0; k < 3; ++k) {
      if (const auto found = middle_of.find(key(p[k], p[(k + 1) % 3])); found != middle_of.end()) mids[k] = found->second;
    }
    add_parts(p, mids, corners);
    first.push_back(static_cast<FaceId>(corners.size() / 3));
  }
  for (Group& group : mesh.groups) {
    std::vector<FaceId> faces;
    for (const FaceId f : group.faces) {
      for (FaceId part = first[f]; part < first[f + 1]; ++part) faces.push_back(part);
    }
    group.faces = std::move(faces);
  }
  mesh.face_points = std::move(corners);
  mesh.face_sizes.assign(mesh.face_points.size() / 3, 3);
}

}  // namespace

Mesh refined(Mesh mesh, std::size_t points) {
  if (std::any_of(mesh.face_sizes.begin(), mesh.face_sizes.end(), [](std::uint32_t size) { return size != 3; })) {
    throw Error(ErrorCode::invalid_argument, "only triangles can be refined");
  }
  while (mesh.points.size() < points) {
    std::vector<Edge> edges = edges_of(mesh);
    const std::size_t wanted = points - mesh.points.size();
    if (edges.empty()) break;
    if (edges.size() > wanted) {
      std::nth_element(edges.begin(), edges.begin() + static_cast<std::ptrdiff_t>(wanted), edges.end());
      edges.resize(wanted);
      std::sort(edges.begin(), edges.end());
    }
    cut(mesh, edges);
  }
  return mesh;
}

}  // namespace deform::bench
