// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/types.h"

namespace deform {

using TriangleCorners = std::array<Vec3, 3>;  ///< corners; two of them may coincide: a segment

/// The point of a triangle that is closest to x (C. Ericson, Real-Time Collision Detection, 2005, 5.1.5).
Vec3 closest_point(const TriangleCorners& triangle, const Vec3& x);

/// Closest points on many triangles, by a tree of bounding boxes. Immutable; any number of threads.
class ClosestPoint {
 public:
  explicit ClosestPoint(std::vector<TriangleCorners> triangles);

  bool empty() const { return triangles_.empty(); }
  /// The first of equally close ones in the order of the tree; there must be a triangle.
  Vec3 operator()(const Vec3& x) const;

 private:
  struct Node {
    Box box;
    std::uint32_t begin = 0, end = 0;
    std::uint32_t right = 0;  // the second child, the first one is next; 0: a leaf
  };

  std::uint32_t build(std::uint32_t begin, std::uint32_t end);

  std::vector<TriangleCorners> triangles_;
  std::vector<Node> nodes_;
};

}  // namespace deform
