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
  std::size_t points = 0;               ///< number of points
  std::size_t faces = 0;                ///< number of faces
  std::size_t corners = 0;              ///< sum of the corners of all faces
  std::size_t triangles = 0;            ///< faces with three corners
  std::size_t quads = 0;                ///< faces with four corners
  std::size_t other_faces = 0;          ///< all other faces
  Box box;                              ///< bounding box of the points
  std::size_t components = 0;           ///< connected by common points; isolated points not counted
  std::size_t edges = 0;                ///< number of edges
  std::size_t boundary_edges = 0;       ///< edges of one face
  std::size_t non_manifold_edges = 0;   ///< edges of more than two faces
  std::size_t inconsistent_edges = 0;   ///< edges whose two faces traverse them in the same direction
  std::size_t non_manifold_points = 0;  ///< as Adjacency::non_manifold_points(), isolated points not counted
  std::size_t degenerate_faces = 0;     ///< repeated corner, fewer than three corners, or area below least_area()
  std::size_t isolated_points = 0;      ///< points without a face
  std::size_t coincident_points = 0;    ///< points with exactly the coordinates of an earlier one
  /// The size of a group.
  struct GroupCount {
    std::string name;    ///< name of the group
    std::size_t points;  ///< number of its points, those of its faces included
    std::size_t faces;   ///< number of its faces
  };
  std::vector<GroupCount> groups;  ///< in the order of the mesh
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
