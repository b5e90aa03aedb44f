// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/mesh/mesh.h"

namespace deform {

/// Compressed lists of faces around each point, and what the k-ring and boundary selections need. Read-only after construction.
class Adjacency {
 public:
  explicit Adjacency(const Mesh& mesh);

  /// Faces that have `point` as a corner, ascending, each once.
  std::span<const FaceId> faces_of(PointId point) const;
  /// Corners of a face.
  std::span<const PointId> points_of(FaceId face) const;

  /// mask of n: `seed` and everything reachable from it in at most `rings` steps between points of one face (thesis 3.5: k-ring).
  /// For rings < 0: everything reachable.
  std::vector<char> grow(const std::vector<char>& seed, int rings) const;

  /// mask of n: end points of edges with exactly one incident face.
  std::vector<char> boundary_points() const;

  /// mask of n: points where the surface is not a (half-)disc: an edge with more than two faces or traversed twice in the same
  /// direction, several fans at one vertex, a face that repeats a corner, or no face at all.
  std::vector<char> non_manifold_points() const;

 private:
  const Mesh& mesh_;  // must outlive this
  std::vector<std::uint64_t> face_offsets_;
  std::vector<std::uint64_t> point_offsets_;
  std::vector<FaceId> point_faces_;
};

}  // namespace deform
