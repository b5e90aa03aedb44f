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

/// The generalized winding number of the faces of a mesh (Jacobson, Kavan, Sorkine-Hornung 2013): the solid angle that they take
/// in at a point, over 4 pi. Of faces that close it is 1 inside (-1 where they face inwards) and 0 outside; holes and cracks
/// change it only near them. Faces are fanned into triangles from their first corner. Groups of triangles that are farther than
/// three times their radius count as dipoles (Barill, Dickson, Schmidt, Levin, Jacobson 2018); the rest is exact.
///
/// Immutable; any number of threads.
class WindingNumber {
 public:
  /// The faces of `mesh` over `points`, one per point of the mesh; nothing is kept of the two.
  WindingNumber(const Mesh& mesh, std::span<const Vec3> points);

  double at(const Vec3& x) const;

  /// Upper bound of the bytes of one of so many triangles.
  static std::size_t bytes_for(std::size_t triangles) { return triangles * (sizeof(Triangle) + sizeof(Node)) + sizeof(Node); }

 private:
  using Triangle = std::array<Vec3, 3>;
  struct Node {
    Vec3 centre{};     ///< mean of the middles, weighted by area
    Vec3 normal{};     ///< sum of the area vectors
    double reach = 0;  ///< square of three times the largest distance of a corner from the centre
    std::uint32_t begin = 0, end = 0;
    std::uint32_t right = 0;  ///< the second child, the first one is next; 0: a leaf
  };

  std::uint32_t build(std::uint32_t begin, std::uint32_t end);

  std::vector<Triangle> triangles_;
  std::vector<Node> nodes_;
};

}  // namespace deform
