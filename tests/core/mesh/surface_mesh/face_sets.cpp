// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/core/mesh/surface_mesh/face_sets.h"

#include <algorithm>

namespace deform::test {

namespace {

constexpr std::uint32_t outside = 0xFFFFFFF0;

using Simplex = std::set<std::uint32_t>;

/// Triangles, with those between a boundary edge and `outside`.
std::vector<Simplex> closed_triangles(const FaceSets& sets) {
  std::vector<Simplex> triangles;
  std::map<Simplex, int> uses;
  for (const Corners& face : sets.faces) {
    triangles.emplace_back(face.begin(), face.end());
    for (std::size_t i = 0; i < face.size(); ++i) ++uses[{face[i], face[(i + 1) % face.size()]}];
  }
  for (const auto& [edge, count] : uses) {
    if (count != 1) continue;
    triangles.push_back(edge);
    triangles.back().insert(outside);
  }
  return triangles;
}

/// Vertices and edges that make triangles with the simplex.
std::set<Simplex> link(const std::vector<Simplex>& triangles, const Simplex& simplex) {
  std::set<Simplex> found;
  for (const Simplex& triangle : triangles) {
    if (!std::includes(triangle.begin(), triangle.end(), simplex.begin(), simplex.end())) continue;
    Simplex rest;
    std::set_difference(triangle.begin(), triangle.end(), simplex.begin(), simplex.end(), std::inserter(rest, rest.end()));
    found.insert(rest);
    for (const std::uint32_t v : rest) found.insert({v});
  }
  return found;
}

template <typename Pairs>
std::size_t component_count(const std::set<std::uint32_t>& nodes, const Pairs& pairs) {
  std::map<std::uint32_t, std::uint32_t> root;
  for (const std::uint32_t node : nodes) root[node] = node;
  const auto find = [&](std::uint32_t node) {
    while (root[node] != node) node = root[node];
    return node;
  };
  std::size_t count = nodes.size();
  for (const auto& [a, b] : pairs) {
    const std::uint32_t x = find(a), y = find(b);
    if (x == y) continue;
    root[x] = y;
    --count;
  }
  return count;
}

}  // namespace

Corners canonical(Corners corners) {
  std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
  return corners;
}

FaceSets face_sets(const SurfaceMesh& mesh) {
  FaceSets sets;
  for (const VertexHandle v : mesh.vertices()) sets.vertices.insert(v.index());
  for (const FaceHandle f : mesh.faces()) {
    Corners corners;
    for (const VertexHandle v : mesh.vertices(f)) corners.push_back(v.index());
    sets.faces.insert(canonical(corners));
  }
  return sets;
}

std::optional<std::map<std::pair<std::uint32_t, std::uint32_t>, Corners>> directed_edges(const FaceSets& sets) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, Corners> edges;
  for (const Corners& face : sets.faces) {
    if (face.size() < 3 || Simplex(face.begin(), face.end()).size() != face.size()) return {};
    for (std::size_t i = 0; i < face.size(); ++i) {
      if (!edges.emplace(std::pair(face[i], face[(i + 1) % face.size()]), face).second) return {};
    }
  }
  return edges;
}

bool is_manifold(const FaceSets& sets) {
  const auto edges = directed_edges(sets);
  if (!edges) return false;
  std::map<std::uint32_t, std::vector<Corners>> around;
  for (const Corners& face : sets.faces) {
    if (sets.faces.contains(canonical({face.rbegin(), face.rend()}))) return false;
    for (const std::uint32_t v : face) around[v].push_back(face);
  }
  for (const auto& [v, faces] : around) {
    // Every face joins the neighbours before and after v: one fan is one component.
    std::set<std::uint32_t> nodes;
    std::vector<std::pair<std::uint32_t, std::uint32_t>> joins;
    for (const Corners& face : faces) {
      const std::size_t i = static_cast<std::size_t>(std::find(face.begin(), face.end(), v) - face.begin());
      joins.emplace_back(face[(i + 1) % face.size()], face[(i + face.size() - 1) % face.size()]);
      nodes.insert({joins.back().first, joins.back().second});
    }
    if (component_count(nodes, joins) != 1) return false;
  }
  return true;
}

Topology topology(const FaceSets& sets) {
  const auto edges = *directed_edges(sets);
  Topology found;
  std::set<std::pair<std::uint32_t, std::uint32_t>> undirected, boundary;
  std::set<std::uint32_t> on_boundary;
  for (const auto& [edge, face] : edges) {
    undirected.insert(std::minmax(edge.first, edge.second));
    if (edges.contains({edge.second, edge.first})) continue;
    boundary.insert(edge);
    on_boundary.insert({edge.first, edge.second});
  }
  found.components = component_count(sets.vertices, undirected);
  found.boundary_loops = component_count(on_boundary, boundary);
  found.euler =
      static_cast<std::ptrdiff_t>(sets.vertices.size() + sets.faces.size()) - static_cast<std::ptrdiff_t>(undirected.size());
  return found;
}

bool meets_link_condition(const FaceSets& sets, std::uint32_t a, std::uint32_t b) {
  const std::vector<Simplex> triangles = closed_triangles(sets);
  const std::set<Simplex> of_a = link(triangles, {a}), of_b = link(triangles, {b}), of_edge = link(triangles, {a, b});
  std::set<Simplex> common;
  std::set_intersection(of_a.begin(), of_a.end(), of_b.begin(), of_b.end(), std::inserter(common, common.end()));
  return common == of_edge;
}

FaceSets collapsed(const FaceSets& sets, std::uint32_t a, std::uint32_t b) {
  FaceSets result{sets.vertices, {}};
  result.vertices.erase(a);
  for (Corners face : sets.faces) {
    std::replace(face.begin(), face.end(), a, b);
    face.erase(std::unique(face.begin(), face.end()), face.end());
    if (face.size() > 1 && face.front() == face.back()) face.pop_back();
    if (face.size() >= 3) result.faces.insert(canonical(face));
  }
  return result;
}

}  // namespace deform::test
