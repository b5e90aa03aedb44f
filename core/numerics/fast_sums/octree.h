// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// The root cube of octrees. Two trees with the same root have boxes on the same lattice at each level.
struct Cube {
  Vec3 centre{};
  double half = 1;  ///< half the edge length
};
/// The smallest cube around all points of both sets, slightly enlarged.
Cube enclosing_cube(std::span<const Vec3> a, std::span<const Vec3> b);

/// An adaptive octree without empty boxes. Boxes are ordered level by level; the points of a box are contiguous.
/// Deterministic; immutable.
class Octree {
 public:
  struct Box {
    std::array<std::int32_t, 3> cell;  ///< position on the lattice of its level
    std::uint32_t begin = 0, end = 0;  ///< range of its points in points()
    std::uint32_t child = 0;           ///< first of its children, which are contiguous
    std::uint8_t children = 0, level = 0;
    bool leaf() const { return children == 0; }
    std::size_t count() const { return end - begin; }
  };

  /// Splits boxes with more than leaf_points points, down to level 20.
  Octree(std::span<const Vec3> points, const Cube& root, std::size_t leaf_points);

  const std::vector<Vec3>& points() const { return points_; }         ///< sorted
  const std::vector<std::uint32_t>& order() const { return order_; }  ///< original index of each sorted point
  const std::vector<Box>& boxes() const { return boxes_; }
  std::size_t levels() const { return level_begin_.size() - 1; }
  std::size_t level_begin(std::size_t level) const { return level_begin_[level]; }  ///< first box of a level, or the end
  double half(std::size_t level) const { return root_.half / static_cast<double>(std::uint64_t{1} << level); }
  Vec3 centre(const Box& box) const;
  std::size_t bytes() const;

 private:
  void split(std::size_t box);

  Cube root_;
  std::vector<Vec3> points_;
  std::vector<std::uint32_t> order_;
  std::vector<Box> boxes_;
  std::vector<std::size_t> level_begin_;
};

}  // namespace deform
