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

/// Where segments cross the faces of a mesh (triangulated as fans around their first corner), by a tree of boxes. Each triangle
/// is intersected on its own (Moeller, Trumbore 1997), so that a segment through an edge may cross both of its triangles or, by
/// rounding, none. Immutable; any number of threads may search at once.
class SegmentCrossings {
 public:
  /// Takes the faces of `mesh` with `points`, one for each of its points, as coordinates. Keeps a reference to neither.
  SegmentCrossings(const Mesh& mesh, std::span<const Vec3> points);

  /// Stores the parameters t in [0, 1] of the crossings a + t (b - a) in `out`, ascending.
  void along(const Vec3& a, const Vec3& b, std::vector<double>& out) const;

  /// An upper bound of the memory in bytes for this number of triangles.
  static std::size_t bytes_for(std::size_t triangles) { return triangles * (sizeof(Triangle) + sizeof(Node)) + sizeof(Node); }

 private:
  using Triangle = std::array<Vec3, 3>;
  struct Node {
    Vec3 min{}, max{};
    std::uint32_t begin = 0, end = 0;
    std::uint32_t right = 0;  ///< the second child, the first one follows this node; 0 for a leaf
  };

  std::uint32_t build(std::uint32_t begin, std::uint32_t end);

  std::vector<Triangle> triangles_;
  std::vector<Node> nodes_;
};

}  // namespace deform
