// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/remeshing/closest_point.h"

#include <algorithm>
#include <limits>

#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr std::uint32_t leaf_size = 8;

double squared_distance_to(const Box& box, const Vec3& x) {
  double sum = 0;
  for (int k = 0; k < 3; ++k) {
    const double outside = std::max({box.min[k] - x[k], x[k] - box.max[k], 0.0});
    sum += outside * outside;
  }
  return sum;
}

Vec3 closest_on_segment(const Vec3& a, const Vec3& b, const Vec3& x) {
  const Vec3 ab = b - a;
  const double size = dot(ab, ab);
  return size > 0 ? a + std::clamp(dot(x - a, ab) / size, 0.0, 1.0) * ab : a;
}

}  // namespace

Vec3 closest_point(const TriangleCorners& triangle, const Vec3& x) {
  const auto& [a, b, c] = triangle;
  const Vec3 ab = b - a, ac = c - a, ax = x - a;
  const Vec3 normal = cross(ab, ac);
  const double size = dot(normal, normal);
  if (size > 0) {
    // Barycentric coordinates of the foot of the perpendicular.
    const double v = dot(cross(ax, ac), normal) / size, w = dot(cross(ab, ax), normal) / size;
    if (v >= 0 && w >= 0 && v + w <= 1) return a + v * ab + w * ac;
  }
  Vec3 best = closest_on_segment(a, b, x);
  for (const Vec3& other : {closest_on_segment(b, c, x), closest_on_segment(c, a, x)}) {
    if (squared_distance(other, x) < squared_distance(best, x)) best = other;
  }
  return best;
}

ClosestPoint::ClosestPoint(std::vector<TriangleCorners> triangles) : triangles_(std::move(triangles)) {
  nodes_.reserve(2 * triangles_.size() / leaf_size + 1);
  if (!triangles_.empty()) build(0, static_cast<std::uint32_t>(triangles_.size()));
}

std::uint32_t ClosestPoint::build(std::uint32_t begin, std::uint32_t end) {
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  nodes_.emplace_back();
  Box box, middles;
  for (std::uint32_t i = begin; i < end; ++i) {
    for (const Vec3& corner : triangles_[i]) box.add(corner);
    middles.add((triangles_[i][0] + triangles_[i][1] + triangles_[i][2]) / 3);
  }
  std::uint32_t right = 0;
  if (end - begin > leaf_size) {
    const auto axis = static_cast<std::size_t>(middles.longest_axis());
    const auto key = [axis](const TriangleCorners& t) { return t[0][axis] + t[1][axis] + t[2][axis]; };
    const std::uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(triangles_.begin() + begin, triangles_.begin() + middle, triangles_.begin() + end,
                     [&](const TriangleCorners& s, const TriangleCorners& t) { return key(s) < key(t); });
    build(begin, middle);
    right = build(middle, end);
  }
  nodes_[index] = {box, begin, end, right};
  return index;
}

ClosestPoint::Found ClosestPoint::find(const Vec3& x, double enough) const {
  double least = std::numeric_limits<double>::infinity();
  Found best;
  std::array<std::uint32_t, 64> open{};  // a halved list has at most 32 levels
  std::size_t count = 1;
  while (count > 0 && (least > enough * enough || enough == 0)) {
    const std::uint32_t index = open[--count];
    const Node& node = nodes_[index];
    if (squared_distance_to(node.box, x) >= least) continue;
    if (node.right == 0) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        const Vec3 candidate = closest_point(triangles_[i], x);
        const double distance = squared_distance(candidate, x);
        if (distance < least) {
          least = distance;
          best = {candidate, i};
        }
      }
      continue;
    }
    const bool right_first = squared_distance_to(nodes_[node.right].box, x) < squared_distance_to(nodes_[index + 1].box, x);
    open[count++] = right_first ? index + 1 : node.right;
    open[count++] = right_first ? node.right : index + 1;
  }
  return best;
}

}  // namespace deform
