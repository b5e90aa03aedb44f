// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "core/base/vectors.h"
#include "core/mesh/inspect.h"
#include "core/mesh/remeshing/closest_point.h"
#include "core/mesh/surface_mesh/surface_mesh.h"

namespace deform::test {

/// Closed, manifold, without degenerate faces, and of the same topology, by other code than that under test.
inline void expect_closed_like(const Mesh& input, const SurfaceMesh& made) {
  made.check();
  const MeshReport before = inspect(input), after = inspect(made.to_mesh());
  EXPECT_EQ(after.boundary_edges + after.non_manifold_edges + after.inconsistent_edges + after.non_manifold_points, 0u);
  EXPECT_EQ(after.degenerate_faces, 0u);
  EXPECT_EQ(after.isolated_points, 0u);
  EXPECT_EQ(after.components, before.components);
  const auto euler = [](const MeshReport& r) {
    return static_cast<std::ptrdiff_t>(r.points - r.isolated_points + r.faces) - static_cast<std::ptrdiff_t>(r.edges);
  };
  EXPECT_EQ(euler(after), euler(before));
}

inline void expect_count(const SurfaceMesh& made, std::size_t vertices) {
  EXPECT_NEAR(static_cast<double>(made.vertex_count()), static_cast<double>(vertices), 0.05 * static_cast<double>(vertices));
}

inline std::vector<TriangleCorners> triangles_of(const Mesh& mesh) {
  std::vector<TriangleCorners> triangles;
  for (std::size_t c = 0; c < mesh.face_points.size(); c += 3) {
    triangles.push_back(
        {mesh.points[mesh.face_points[c]], mesh.points[mesh.face_points[c + 1]], mesh.points[mesh.face_points[c + 2]]});
  }
  return triangles;
}

/// The largest distance of a point of `from` from the faces of `to`.
inline double farthest(const Mesh& from, const Mesh& to) {
  const ClosestPoint closest(triangles_of(to));
  double largest = 0;
  for (const Vec3& x : from.points) largest = std::max(largest, distance(x, closest(x)));
  return largest;
}

}  // namespace deform::test
