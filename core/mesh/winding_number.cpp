// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/winding_number.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/base/vectors.h"
#include "core/mesh/face_triangles.h"

namespace deform {

namespace {

constexpr std::uint32_t leaf_size = 8;
constexpr double far = 3;  // radii

/// The solid angle over 4 pi (van Oosterom, Strackee 1983).
double solid_angle(const Vec3& a, const Vec3& b, const Vec3& c) {
  const double la = length(a), lb = length(b), lc = length(c);
  const double below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
  return std::atan2(dot(a, cross(b, c)), below) / (2 * std::numbers::pi);
}

}  // namespace

WindingNumber::WindingNumber(const Mesh& mesh, std::span<const Vec3> points) {
  for_each_triangle(mesh, points, [&](const Vec3& a, const Vec3& b, const Vec3& c) { triangles_.push_back({a, b, c}); });
  if (!triangles_.empty()) build(0, static_cast<std::uint32_t>(triangles_.size()));
}

std::uint32_t WindingNumber::build(std::uint32_t begin, std::uint32_t end) {
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  nodes_.emplace_back();
  Node node;
  node.begin = begin;
  node.end = end;
  double area = 0;
  Vec3 sum{};
  std::array<double, 3> least, most;
  least.fill(HUGE_VAL);
  most.fill(-HUGE_VAL);
  for (std::uint32_t t = begin; t < end; ++t) {
    const auto& [a, b, c] = triangles_[t];
    const Vec3 normal = 0.5 * cross(b - a, c - a), middle = (a + b + c) / 3;
    const double size = length(normal);
    node.normal = node.normal + normal;
    sum = sum + size * middle;
    area += size;
    for (std::size_t k = 0; k < 3; ++k) {
      least[k] = std::min(least[k], middle[k]);
      most[k] = std::max(most[k], middle[k]);
    }
  }
  node.centre = area > 0 ? sum / area : triangles_[begin][0];
  double radius = 0;
  for (std::uint32_t t = begin; t < end; ++t) {
    for (const Vec3& x : triangles_[t]) radius = std::max(radius, squared_distance(x, node.centre));
  }
  node.reach = far * far * radius;
  if (end - begin > leaf_size) {
    std::size_t axis = 0;
    for (std::size_t k = 1; k < 3; ++k) {
      if (most[k] - least[k] > most[axis] - least[axis]) axis = k;
    }
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

double WindingNumber::at(const Vec3& x) const {
  if (nodes_.empty()) return 0;
  double sum = 0;
  std::array<std::uint32_t, 64> waiting;  // halves of at most 2^32 triangles
  std::size_t count = 0;
  waiting[count++] = 0;
  while (count > 0) {
    const std::uint32_t index = waiting[--count];
    const Node& node = nodes_[index];
    const Vec3 to = node.centre - x;
    const double square = dot(to, to);
    if (square > node.reach) {
      sum += dot(node.normal, to) / (4 * std::numbers::pi * square * std::sqrt(square));
    } else if (node.right != 0) {
      waiting[count++] = node.right;
      waiting[count++] = index + 1;
    } else {
      for (std::uint32_t t = node.begin; t < node.end; ++t) {
        sum += solid_angle(triangles_[t][0] - x, triangles_[t][1] - x, triangles_[t][2] - x);
      }
    }
  }
  return sum;
}

}  // namespace deform
