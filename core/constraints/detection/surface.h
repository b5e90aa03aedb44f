// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/constraints/detection/shape.h"
#include "core/mesh/mesh.h"

namespace deform::detection {

/// The adjacent face across an edge.
struct Neighbour {
  FaceId face = 0;
  PointId from = 0, to = 0;  ///< end points of the edge, after merging coincident points
  bool against = false;      ///< the two run along the edge in the same direction, so that one of them is turned around
  double angle = 0;          ///< angle between the normals, 0..pi; 0 next to a face without area
};

/// A mesh prepared for detection, in coordinates relative to its centre and divided by its size. Immutable after construction;
/// any number of threads may read.
struct Surface {
  Surface() = default;  ///< empty, to be filled by the caller
  explicit Surface(const Mesh& mesh, const RunContext& context);

  std::size_t face_count() const { return area.size(); }
  std::span<const PointId> corners(std::size_t face) const {
    return {joined_corners.data() + offsets[face], static_cast<std::size_t>(offsets[face + 1] - offsets[face])};
  }
  std::span<const Neighbour> neighbours(std::size_t face) const {
    return {adjacent.data() + first[face], static_cast<std::size_t>(first[face + 1] - first[face])};
  }
  /// The largest error of a face normal caused by noise of its corners, radians.
  double allowance(std::size_t face) const { return height[face] > 0 ? std::min(1.6, (4 * noise + 1e-8) / height[face]) : 1.6; }
  /// Neighbours that are not behind a sharp edge.
  std::span<const FaceId> passages(std::size_t face) const {
    return {passage.data() + first_passage[face], static_cast<std::size_t>(first_passage[face + 1] - first_passage[face])};
  }
  bool passable(std::size_t face, const Neighbour& n) const {
    return n.angle <= maximum_angle + allowance(face) + allowance(n.face);
  }
  /// Sets the members that depend on the angle of sharp edges. Requires the noise to be set.
  void find_passages(double maximum_angle);
  /// Corners and normals of about `most` evenly chosen faces. For many faces only one corner of each is used, since
  /// corners repeat.
  FitData data(std::span<const FaceId> faces, std::size_t most) const;

  Vector3d middle = Vector3d::Zero();  ///< model units
  double size = 0;                     ///< model units
  double model_area = 0;               ///< model units squared
  double total_area = 0;
  double noise = 0;
  double maximum_angle = 0;

  std::vector<Vector3d> points;
  std::vector<std::uint64_t> offsets;
  std::vector<PointId> joined_corners;  ///< corners, with coincident points merged into the first
  std::vector<Vector3d> normal;         ///< unit normals, oriented consistently across edges; zero for faces without area
  std::vector<Vector3d> centre;
  std::vector<double> area;
  std::vector<double> height;  ///< twice the area over the longest edge
  std::vector<std::uint64_t> first;
  std::vector<Neighbour> adjacent;
  std::vector<std::uint64_t> first_passage;
  std::vector<FaceId> passage;
  std::vector<double> least_cosine;  ///< smallest cosine between the normals of a face and of its shape
  std::vector<char> level;           ///< whether a neighbour lies in the same plane

 private:
  void join_points(const Mesh& mesh);
  void scale(const Mesh& mesh);
  void measure_faces(const RunContext& context);
  void connect();
  void orient();
};

/// The standard deviation of points from a quadratic surface fitted to their 2-ring inside sharp edges: the lower quartile over
/// up to 4000 points, so that feature edges have no influence. 0 if no point has such a neighbourhood.
double estimated_noise(const Surface& surface, double sharp, const RunContext& context);

}  // namespace deform::detection
