// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <initializer_list>
#include <vector>

#include "core/mesh/mesh.h"

namespace deform::test {

// Small meshes with names that say why they exist. Each is the smallest that shows the case.

inline Mesh make_mesh(Points points, std::initializer_list<std::vector<PointId>> faces) {
  Mesh mesh;
  mesh.points = std::move(points);
  for (const auto& face : faces) {
    mesh.face_sizes.push_back(static_cast<std::uint32_t>(face.size()));
    mesh.face_points.insert(mesh.face_points.end(), face.begin(), face.end());
  }
  return mesh;
}

/// Point 0 in the middle of a closed ring 1..6 of triangles.
inline Mesh one_ring() {
  return make_mesh({{0, 0, 0}, {2, 0, 0}, {1, 2, 0}, {-1, 2, 0}, {-2, 0, 0}, {-1, -2, 0}, {1, -2, 0}},
                   {{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}, {0, 5, 6}, {0, 6, 1}});
}

/// Apex 0 above a ring 1..4 whose last face is missing: the apex lies on the boundary.
inline Mesh open_cone() {
  return make_mesh({{0, 0, 1}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}}, {{0, 1, 2}, {0, 2, 3}, {0, 3, 4}});
}

/// Two cones that touch in their apex 0 only.
inline Mesh two_fans() {
  return make_mesh({{0, 0, 0}, {1, 0, 1}, {0, 1, 1}, {-1, -1, 1}, {1, 0, -1}, {0, 1, -1}, {-1, -1, -1}},
                   {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {0, 5, 4}, {0, 6, 5}, {0, 4, 6}});
}

/// Edge 0-1 with three faces.
inline Mesh non_manifold_edge() {
  return make_mesh({{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {-1, 1, 0}, {-1, -1, 0}}, {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}});
}

/// Edge 0-1 runs the same way in both faces.
inline Mesh flipped_neighbour() { return make_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, -1, 0}}, {{0, 1, 2}, {0, 1, 3}}); }

/// The second face repeats corner 1.
inline Mesh repeated_corner() { return make_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}, {{0, 1, 2}, {1, 3, 1}}); }

/// A closed tetrahedron, outward.
inline Mesh tetrahedron() {
  return make_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}});
}

/// nx x ny unit quads in the plane z = 0; point (i, j) has number j * (nx + 1) + i.
inline Mesh quad_grid(unsigned nx, unsigned ny) {
  Mesh mesh;
  for (unsigned j = 0; j <= ny; ++j) {
    for (unsigned i = 0; i <= nx; ++i) mesh.points.push_back({double(i), double(j), 0});
  }
  for (unsigned j = 0; j < ny; ++j) {
    for (unsigned i = 0; i < nx; ++i) {
      const PointId a = j * (nx + 1) + i;
      mesh.face_sizes.push_back(4);
      mesh.face_points.insert(mesh.face_points.end(), {a, a + 1, a + nx + 2, a + nx + 1});
    }
  }
  return mesh;
}

/// A triangle, an isolated point 3 and a point 4 in the place of point 0.
inline Mesh with_loose_points() { return make_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {5, 5, 5}, {0, 0, 0}}, {{0, 1, 2}}); }

inline std::vector<PointId> selected(const std::vector<char>& mask) {
  std::vector<PointId> ids;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask[i]) ids.push_back(static_cast<PointId>(i));
  }
  return ids;
}

inline std::vector<char> mask_of(const Mesh& mesh, std::initializer_list<PointId> ids) {
  std::vector<char> mask(mesh.point_count(), 0);
  for (const PointId id : ids) mask[id] = 1;
  return mask;
}

}  // namespace deform::test
