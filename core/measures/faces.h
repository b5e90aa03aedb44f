// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform::measures {

using Triangle = std::array<PointId, 3>;  ///< ids of its corners, counter-clockwise seen from outside

/// Where the faces of a measure come from.
enum class FaceSource {
  faces,  ///< those of the mesh
  cells,  ///< the outer faces of its cells: those of exactly one cell, with normals out of it
};

/// What happens to faces that do not close.
enum class Rims {
  refuse,  ///< an error, which names an edge
  close,   ///< each connected rim is closed by triangles to the mean of its points, which moves with them: exact for plane rims
};

/// The faces that are measured.
struct FaceChoice {
  std::vector<std::string> groups;        ///< names of groups of faces; empty: all faces. A face of several groups counts once
  FaceSource source = FaceSource::faces;  ///< where the faces come from
};

/// Triangles, and the face of each: faces are fans around their first corner. For FaceSource::cells the faces are numbered as
/// boundary_faces() has them, or by their ids in PolyhedralCells.
struct FaceTriangles {
  std::vector<Triangle> triangles;  ///< t
  std::vector<FaceId> faces;        ///< t

  /// The bounding box of the corners.
  Box box(std::span<const Vec3> points) const;
};

/// Throws Error(invalid_argument) naming groups[i] for a name that is no group of the mesh or of one without faces, `groups`
/// where they are given with FaceSource::cells, and `faces` or `cells` where the mesh has none.
FaceTriangles chosen_triangles(const Mesh& mesh, const FaceChoice& choice);

/// The closed surface of a body, with normals that point outwards. Immutable.
class Body {
 public:
  /// Points with the same coordinates in the mesh count as one for what is closed. Faces that enclose a negative volume, such as
  /// those of a patch of a mesh of the space around the body, are turned. Throws as chosen_triangles(), and
  /// Error(invalid_argument) naming `faces` where the faces are not closed and rims are refused, where neighbours are oriented
  /// against each other, and where they enclose no volume: less than 1e-12 of their area times the diagonal of their box.
  Body(const Mesh& mesh, const FaceChoice& choice, Rims rims);

  std::size_t point_count() const { return points_; }  ///< n
  /// All triangles: first those of the faces, then those that close rims, whose centre k has the id n + k.
  const std::vector<Triangle>& triangles() const { return triangles_; }
  /// The number of triangles of faces, and the face of each.
  const std::vector<FaceId>& faces() const { return faces_; }
  bool turned() const { return turned_; }                 ///< whether the faces were turned
  std::size_t rim_count() const { return rims_.size(); }  ///< number of connected rims

  /// The points and after them the centres of the rims.
  Points with_centres(std::span<const Vec3> points) const;
  /// Turns derivatives at the points and centres into derivatives at the points alone, n.
  void carry_centres(Points& gradient) const;

 private:
  void close(const Mesh& mesh, const FaceChoice& choice, Rims rims);

  std::size_t points_;
  std::vector<Triangle> triangles_;
  std::vector<FaceId> faces_;
  std::vector<std::vector<PointId>> rims_;  ///< the points of each rim
  bool turned_ = false;
};

}  // namespace deform::measures
