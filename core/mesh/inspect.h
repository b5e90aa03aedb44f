// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The statistics that `deform inspect` prints.
struct MeshReport {
  std::size_t points = 0, faces = 0, corners = 0;
  std::size_t triangles = 0, quads = 0, other_faces = 0;
  Box box;
  std::size_t components = 0;  ///< connected by common points; isolated points not counted
  std::size_t edges = 0, boundary_edges = 0, non_manifold_edges = 0, inconsistent_edges = 0;
  std::size_t non_manifold_points = 0;  ///< as Adjacency::non_manifold_points(), isolated points not counted
  std::size_t degenerate_faces = 0;     ///< repeated corner, fewer than three corners, or area below least_area()
  std::size_t isolated_points = 0;
  std::size_t coincident_points = 0;  ///< points with exactly the coordinates of an earlier one
  struct GroupCount {
    std::string name;
    std::size_t points, faces;  ///< points includes the points of the faces
  };
  std::vector<GroupCount> groups;
};

/// The area below which a face counts as degenerate: 1e-12 of the squared length of its longest edge, plus the rounding error of
/// areas in a mesh with a bounding box of this diagonal.
double least_area(std::span<const Vec3> points, std::span<const PointId> corners, double diagonal);

MeshReport inspect(const Mesh& mesh);

/// For each point the least id of all points with the same coordinates: readers merge nothing, so that each facet of an STL file
/// has corners of its own.
std::vector<PointId> coincident_points(std::span<const Vec3> points);

/// For each group of the mesh, the number of points that a region of this group selects: its points and those of its faces, each
/// counted once.
std::vector<std::size_t> group_point_counts(const Mesh& mesh);

}  // namespace deform
