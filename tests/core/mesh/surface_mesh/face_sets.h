// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "core/mesh/surface_mesh/surface_mesh.h"

namespace deform::test {

using Corners = std::vector<std::uint32_t>;

/// The corners from the smallest on.
Corners canonical(Corners corners);

/// A surface as the set of its vertices and the set of its faces.
struct FaceSets {
  std::set<std::uint32_t> vertices;
  std::set<Corners> faces;

  bool operator==(const FaceSets&) const = default;
};

FaceSets face_sets(const SurfaceMesh& mesh);

/// The face along every directed edge. Nothing when an edge has two faces on one side, or a face fewer than three corners
/// or one twice.
std::optional<std::map<std::pair<std::uint32_t, std::uint32_t>, Corners>> directed_edges(const FaceSets& sets);

/// Edges have at most one face on each side, no two faces enclose nothing between them, and the faces of a vertex are one fan.
bool is_manifold(const FaceSets& sets);

/// Components by shared vertices, boundary loops and the Euler characteristic: with orientation they tell closed and open
/// surfaces apart.
struct Topology {
  std::size_t components = 0, boundary_loops = 0;
  std::ptrdiff_t euler = 0;

  bool operator==(const Topology&) const = default;
};
Topology topology(const FaceSets& sets);

/// The link condition of a triangle mesh, by links as sets: with every boundary edge joined to one more vertex, the links of a
/// and b have no more in common than the link of the edge.
bool meets_link_condition(const FaceSets& sets, std::uint32_t a, std::uint32_t b);

/// a becomes b in all faces; what is left of fewer than three corners goes.
FaceSets collapsed(const FaceSets& sets, std::uint32_t a, std::uint32_t b);

}  // namespace deform::test
