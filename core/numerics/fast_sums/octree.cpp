// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/fast_sums/octree.h"

#include <algorithm>
#include <numeric>

namespace deform {

namespace {
constexpr std::size_t deepest = 20;
}

Cube enclosing_cube(std::span<const Vec3> a, std::span<const Vec3> b) {
  Box box;
  for (const Vec3& p : a) box.add(p);
  for (const Vec3& p : b) box.add(p);
  Cube cube{{}, 0};
  for (std::size_t k = 0; k < 3; ++k) {
    cube.centre[k] = 0.5 * (box.min[k] + box.max[k]);
    cube.half = std::max(cube.half, 0.5 * (box.max[k] - box.min[k]));
  }
  cube.half = cube.half > 0 ? 1.0001 * cube.half : 1.0;
  return cube;
}

Octree::Octree(std::span<const Vec3> points, const Cube& root, std::size_t leaf_points) : root_(root), order_(points.size()) {
  points_.assign(points.begin(), points.end());
  std::iota(order_.begin(), order_.end(), 0u);
  Box whole{};
  whole.end = static_cast<std::uint32_t>(points.size());
  boxes_.push_back(whole);
  level_begin_ = {0, 1};
  for (std::size_t level = 0; level < deepest; ++level) {
    const std::size_t begin = level_begin_[level], end = level_begin_[level + 1];
    for (std::size_t box = begin; box < end; ++box) {
      if (boxes_[box].count() > leaf_points) split(box);
    }
    if (boxes_.size() == end) break;
    level_begin_.push_back(boxes_.size());
  }
}

Vec3 Octree::centre(const Box& box) const {
  const double h = half(box.level);
  Vec3 centre;
  for (std::size_t k = 0; k < 3; ++k) centre[k] = root_.centre[k] - root_.half + h * (2 * box.cell[k] + 1);
  return centre;
}

void Octree::split(std::size_t at) {
  const Box parent = boxes_[at];
  const Vec3 middle = centre(parent);
  const auto octant = [&](const Vec3& p) {
    return static_cast<unsigned>(p[0] >= middle[0]) << 2 | static_cast<unsigned>(p[1] >= middle[1]) << 1 |
           static_cast<unsigned>(p[2] >= middle[2]);
  };
  // Counting sort, stable, so that the order depends on the points only.
  std::array<std::uint32_t, 9> start{};
  for (std::uint32_t i = parent.begin; i < parent.end; ++i) ++start[octant(points_[i]) + 1];
  std::partial_sum(start.begin(), start.end(), start.begin());
  std::array<std::uint32_t, 8> next;
  std::copy_n(start.begin(), 8, next.begin());
  std::vector<Vec3> points(parent.count());
  std::vector<std::uint32_t> order(parent.count());
  for (std::uint32_t i = parent.begin; i < parent.end; ++i) {
    const std::uint32_t to = next[octant(points_[i])]++;
    points[to] = points_[i];
    order[to] = order_[i];
  }
  std::copy(points.begin(), points.end(), points_.begin() + parent.begin);
  std::copy(order.begin(), order.end(), order_.begin() + parent.begin);
  boxes_[at].child = static_cast<std::uint32_t>(boxes_.size());
  for (unsigned o = 0; o < 8; ++o) {
    if (start[o] == start[o + 1]) continue;
    Box child{};
    child.cell = {2 * parent.cell[0] + static_cast<std::int32_t>(o >> 2),
                  2 * parent.cell[1] + static_cast<std::int32_t>(o >> 1 & 1),
                  2 * parent.cell[2] + static_cast<std::int32_t>(o & 1)};
    child.begin = parent.begin + start[o];
    child.end = parent.begin + start[o + 1];
    child.level = static_cast<std::uint8_t>(parent.level + 1);
    boxes_.push_back(child);
    ++boxes_[at].children;
  }
}

std::size_t Octree::bytes() const {
  return points_.size() * (sizeof(Vec3) + sizeof(std::uint32_t)) + boxes_.size() * sizeof(Box);
}

}  // namespace deform
