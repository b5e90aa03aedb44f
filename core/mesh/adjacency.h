// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/mesh/mesh.h"

namespace deform {

/// The faces around each point as compressed rows, with the k-ring and boundary selections built on them. Immutable; any number
/// of threads may read.
class Adjacency {
 public:
  explicit Adjacency(const Mesh& mesh);  ///< the mesh must outlive it

  /// The faces with `point` as a corner, ascending, each once.
  std::span<const FaceId> faces_of(PointId point) const;
  /// The corners of a face.
  std::span<const PointId> points_of(FaceId face) const;

  /// A mask of n points: `seed` and all points reachable from it in at most `rings` steps between points of a common face (thesis
  /// 3.5: k-ring). If rings < 0, all points reachable in any number of steps.
  std::vector<char> grow(const std::vector<char>& seed, int rings) const;

  /// A mask of n points: the end points of edges with exactly one incident face.
  std::vector<char> boundary_points() const;

  /// A mask of n points: those where the surface is not a disc or half-disc, because of an edge with more than two faces or with
  /// two faces that traverse it in the same direction, several fans, a face that repeats a corner, or no face at all.
  std::vector<char> non_manifold_points() const;

 private:
  const Mesh& mesh_;  // must outlive this
  std::vector<std::uint64_t> face_offsets_;
  std::vector<std::uint64_t> point_offsets_;
  std::vector<FaceId> point_faces_;
};

}  // namespace deform
