// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The generalized winding number of the faces of a mesh (Jacobson, Kavan, Sorkine-Hornung 2013): the solid angle that they
/// subtend at a point, divided by 4 pi. For a closed surface it is 1 inside (-1 if its faces are oriented inwards) and 0 outside;
/// holes and cracks change it only nearby. Faces are triangulated as fans around their first corner. Clusters of triangles at
/// more than three times their radius are approximated by dipoles (Barill, Dickson, Schmidt, Levin, Jacobson 2018); the others
/// are summed exactly.
///
/// Immutable; any number of threads may call at().
class WindingNumber {
 public:
  /// Takes the faces of `mesh` with `points`, one for each of its points, as coordinates. Keeps a reference to neither.
  WindingNumber(const Mesh& mesh, std::span<const Vec3> points);

  double at(const Vec3& x) const;

  /// An upper bound of the memory in bytes for this number of triangles.
  static std::size_t bytes_for(std::size_t triangles) { return triangles * (sizeof(Triangle) + sizeof(Node)) + sizeof(Node); }

 private:
  using Triangle = std::array<Vec3, 3>;
  struct Node {
    Vec3 centre{};     ///< mean of the centroids, weighted by area
    Vec3 normal{};     ///< sum of the area vectors
    double reach = 0;  ///< squared; three times the largest distance of a corner from the centre
    std::uint32_t begin = 0, end = 0;
    std::uint32_t right = 0;  ///< the second child, the first one follows this node; 0 for a leaf
  };

  std::uint32_t build(std::uint32_t begin, std::uint32_t end);

  std::vector<Triangle> triangles_;
  std::vector<Node> nodes_;
};

}  // namespace deform
