// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/segment_crossings.h"

#include <algorithm>
#include <cmath>

#include "core/base/vectors.h"
#include "core/mesh/face_triangles.h"

namespace deform {

namespace {

constexpr std::uint32_t triangles_of_leaf = 4;

/// Whether the segment from a along d meets a box.
bool meets(const Vec3& a, const Vec3& d, const Vec3& min, const Vec3& max) {
  double from = 0, to = 1;
  for (std::size_t k = 0; k < 3; ++k) {
    if (d[k] == 0) {
      if (a[k] < min[k] || a[k] > max[k]) return false;
      continue;
    }
    const double s = (min[k] - a[k]) / d[k], t = (max[k] - a[k]) / d[k];
    from = std::max(from, std::min(s, t));
    to = std::min(to, std::max(s, t));
  }
  return from <= to;
}

/// The parameter of the crossing, or -1.
double crossing(const std::array<Vec3, 3>& triangle, const Vec3& a, const Vec3& d) {
  const Vec3 u = triangle[1] - triangle[0], v = triangle[2] - triangle[0], p = cross(d, v);
  const double determinant = dot(u, p);
  if (determinant == 0) return -1;
  const Vec3 from = a - triangle[0], q = cross(from, u);
  const double s = dot(from, p) / determinant, t = dot(d, q) / determinant, at = dot(v, q) / determinant;
  return s >= 0 && t >= 0 && s + t <= 1 && at >= 0 && at <= 1 ? at : -1;
}

}  // namespace

SegmentCrossings::SegmentCrossings(const Mesh& mesh, std::span<const Vec3> points) {
  for_each_triangle(mesh, points, [&](const Vec3& a, const Vec3& b, const Vec3& c) { triangles_.push_back({a, b, c}); });
  if (!triangles_.empty()) build(0, static_cast<std::uint32_t>(triangles_.size()));
}

std::uint32_t SegmentCrossings::build(std::uint32_t begin, std::uint32_t end) {
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  nodes_.emplace_back();
  Node node;
  node.begin = begin;
  node.end = end;
  node.min.fill(HUGE_VAL);
  node.max.fill(-HUGE_VAL);
  for (std::uint32_t t = begin; t < end; ++t) {
    for (const Vec3& x : triangles_[t]) {
      for (std::size_t k = 0; k < 3; ++k) {
        node.min[k] = std::min(node.min[k], x[k]);
        node.max[k] = std::max(node.max[k], x[k]);
      }
    }
  }
  if (end - begin > triangles_of_leaf) {
    const Vec3 extent = node.max - node.min;
    const auto axis = static_cast<std::size_t>(std::max_element(extent.begin(), extent.end()) - extent.begin());
    const std::uint32_t middle = begin + (end - begin) / 2;
    const auto before = [axis](const Triangle& s, const Triangle& t) {
      return s[0][axis] + s[1][axis] + s[2][axis] < t[0][axis] + t[1][axis] + t[2][axis];
    };
    std::nth_element(triangles_.begin() + begin, triangles_.begin() + middle, triangles_.begin() + end, before);
    build(begin, middle);
    node.right = build(middle, end);
  }
  nodes_[index] = node;
  return index;
}

void SegmentCrossings::along(const Vec3& a, const Vec3& b, std::vector<double>& out) const {
  out.clear();
  if (nodes_.empty()) return;
  const Vec3 d = b - a;
  std::array<std::uint32_t, 64> waiting;
  std::size_t count = 0;
  waiting[count++] = 0;
  while (count > 0) {
    const std::uint32_t index = waiting[--count];
    const Node& node = nodes_[index];
    if (!meets(a, d, node.min, node.max)) continue;
    if (node.right != 0) {
      waiting[count++] = node.right;
      waiting[count++] = index + 1;
      continue;
    }
    for (std::uint32_t t = node.begin; t < node.end; ++t) {
      const double at = crossing(triangles_[t], a, d);
      if (at >= 0) out.push_back(at);
    }
  }
  std::sort(out.begin(), out.end());
}

}  // namespace deform
