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
  struct Found {
    Vec3 point{};
    std::uint32_t triangle = 0;  ///< that has it, by its place in the order of the tree
  };
  /// The first of equally close ones in the order of the tree, or any that is at most `enough` (model units) away, which takes
  /// less time; there must be a triangle.
  Found find(const Vec3& x, double enough = 0) const;
  /// Its point.
  Vec3 operator()(const Vec3& x) const { return find(x).point; }
  const TriangleCorners& triangle(std::uint32_t index) const { return triangles_[index]; }

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
