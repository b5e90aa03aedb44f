// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/triangle_tree.h"

#include <numbers>
#include <numeric>

#include "core/base/parallel.h"

namespace deform {

namespace {

/// The nearest place on the edge from corner i to corner j.
PlaceOnTriangle nearest_on_edge(const std::array<Vec3, 3>& corners, std::size_t i, std::size_t j, const Vec3& x) {
  const Vec3 along = corners[j] - corners[i];
  const double size = dot(along, along);
  const double t = size > 0 ? std::clamp(dot(x - corners[i], along) / size, 0.0, 1.0) : 0;
  PlaceOnTriangle place;
  place.triangle = 0;
  place.weights[i] = 1 - t;
  place.weights[j] = t;
  place.point = corners[i] + t * along;
  place.distance = squared_distance(place.point, x);
  return place;
}

}  // namespace

PlaceOnTriangle nearest_on_triangle(const std::array<Vec3, 3>& corners, const Vec3& x) {
  const Vec3 ab = corners[1] - corners[0], ac = corners[2] - corners[0], ax = x - corners[0];
  const Vec3 normal = cross(ab, ac);
  const double size = dot(normal, normal);
  if (size > 0) {
    // Barycentric coordinates of the foot of the perpendicular.
    const double v = dot(cross(ax, ac), normal) / size, w = dot(cross(ab, ax), normal) / size;
    if (v >= 0 && w >= 0 && v + w <= 1) {
      PlaceOnTriangle place{0, {1 - v - w, v, w}, corners[0] + v * ab + w * ac, 0};
      place.distance = squared_distance(place.point, x);
      return place;
    }
  }
  PlaceOnTriangle best = nearest_on_edge(corners, 0, 1, x);
  for (std::size_t i = 1; i < 3; ++i) {
    const PlaceOnTriangle other = nearest_on_edge(corners, i, (i + 1) % 3, x);
    if (other.distance < best.distance) best = other;
  }
  return best;
}

Ray::Ray(const Vec3& origin, const Vec3& direction) : origin_(origin), direction_(direction) {
  std::size_t z = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (std::abs(direction[k]) > std::abs(direction[z])) z = k;
  }
  axes_ = {(z + 1) % 3, (z + 2) % 3, z};
  shear_ = {direction[axes_[0]] / direction[z], direction[axes_[1]] / direction[z], 1 / direction[z]};
  for (std::size_t k = 0; k < 3; ++k) inverse_[k] = 1 / direction[k];
}

PlaceOnTriangle Ray::meet(const std::array<Vec3, 3>& corners) const {
  std::array<double, 3> x, y, z;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3 from = corners[i] - origin_;
    z[i] = from[axes_[2]];
    x[i] = from[axes_[0]] - shear_[0] * z[i];
    y[i] = from[axes_[1]] - shear_[1] * z[i];
  }
  PlaceOnTriangle place;
  // The function of an edge changes nothing but its sign where the neighbour traverses it the other way round.
  std::array<double, 3> edge;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
    edge[i] = x[k] * y[j] - y[k] * x[j];
  }
  if (std::min({edge[0], edge[1], edge[2]}) < 0 && std::max({edge[0], edge[1], edge[2]}) > 0) return place;
  const double sum = edge[0] + edge[1] + edge[2];
  if (sum == 0) return place;
  const double at = (edge[0] * z[0] + edge[1] * z[1] + edge[2] * z[2]) / sum * shear_[2];
  if (!(at >= 0)) return place;
  place.triangle = 0;
  for (std::size_t i = 0; i < 3; ++i) place.weights[i] = edge[i] / sum;
  place.point = origin_ + at * direction_;
  place.distance = at;
  return place;
}

bool Ray::meets(const Box& box, double nearest) const {
  double from = 0, to = nearest;
  for (std::size_t k = 0; k < 3; ++k) {
    if (direction_[k] == 0) {
      if (origin_[k] < box.min[k] || origin_[k] > box.max[k]) return false;
      continue;
    }
    const double s = (box.min[k] - origin_[k]) * inverse_[k], t = (box.max[k] - origin_[k]) * inverse_[k];
    from = std::max(from, std::min(s, t));
    // Rounding must not make the ray pass by a box that it touches (T. Ize, Robust BVH ray traversal, JCGT 2(2), 2013).
    to = std::min(to, std::max(s, t) * (1 + 8 * std::numeric_limits<double>::epsilon()));
  }
  return from <= to;
}

TriangleTree::TriangleTree(std::span<const std::array<PointId, 3>> triangles, std::span<const Vec3> points,
                           const RunContext& context)
    : triangles_(triangles.begin(), triangles.end()), order_(triangles.size()) {
  std::iota(order_.begin(), order_.end(), 0U);
  if (triangles_.empty()) return;
  corners_.resize(triangles_.size());
  for (std::size_t i = 0; i < triangles_.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) corners_[i][k] = points[triangles_[i][k]];
  }
  nodes_.reserve(triangles_.size());
  build(0, static_cast<std::uint32_t>(triangles_.size()), context);
  boxes_.resize(nodes_.size());
  place(points, context);
}

// corners_ has the order of the triangles here.
std::uint32_t TriangleTree::build(std::uint32_t begin, std::uint32_t end, const RunContext& context) {
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  nodes_.push_back({begin, end, 0});
  if (end - begin <= leaf_size) return index;
  if (end - begin > triangles_without_check) context.check();
  const auto middle_of = [&](std::uint32_t i) { return corners_[i][0] + corners_[i][1] + corners_[i][2]; };
  Box middles;
  for (std::uint32_t i = begin; i < end; ++i) middles.add(middle_of(order_[i]));
  const auto axis = static_cast<std::size_t>(middles.longest_axis());
  const std::uint32_t middle = begin + (end - begin) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end, [&](std::uint32_t s, std::uint32_t t) {
    const double place_s = middle_of(s)[axis], place_t = middle_of(t)[axis];
    return place_s != place_t ? place_s < place_t : s < t;
  });
  build(begin, middle, context);
  const std::uint32_t right = build(middle, end, context);
  nodes_[index].right = right;
  return index;
}

void TriangleTree::place(std::span<const Vec3> points, const RunContext& context) {
  constexpr std::size_t grain = 16384;
  parallel_for(context, order_.size(), grain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      for (std::size_t k = 0; k < 3; ++k) corners_[i][k] = points[triangles_[order_[i]][k]];
    }
  });
  // Children stand behind their parent.
  for (std::size_t index = nodes_.size(); index-- > 0;) {
    const Node& node = nodes_[index];
    Box box;
    if (node.right == 0) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        for (const Vec3& corner : corners_[i]) box.add(corner);
      }
    } else {
      for (const std::size_t child : {index + 1, static_cast<std::size_t>(node.right)}) {
        box.add(boxes_[child].min);
        box.add(boxes_[child].max);
      }
    }
    boxes_[index] = box;
  }
}

NormalCones TriangleTree::cones(std::span<const Vec3> normals, double least_cosine, const RunContext& context) const {
  NormalCones cones;
  cones.axes_.resize(nodes_.size());
  cones.least_.assign(nodes_.size(), -2);
  constexpr double rounding = 1e-9;
  const double angle = std::acos(least_cosine);
  parallel_for(context, nodes_.size(), 1024, [&](std::size_t begin, std::size_t end) {
    for (std::size_t index = begin; index < end; ++index) {
      const Node& node = nodes_[index];
      Vec3 sum{};
      for (std::uint32_t i = node.begin; i < node.end; ++i) sum = sum + normals[order_[i]];
      const double size = length(sum);
      if (!(size > rounding)) continue;
      const Vec3 axis = sum / size;
      double widest = 1;
      for (std::uint32_t i = node.begin; i < node.end; ++i) widest = std::min(widest, dot(axis, normals[order_[i]]));
      cones.axes_[index] = axis;
      const double reach = std::acos(std::max(widest, -1.0)) + angle;
      if (reach < std::numbers::pi) cones.least_[index] = std::cos(reach) - rounding;
    }
  });
  return cones;
}

TriangleTree TriangleTree::moved(std::span<const Vec3> points, const RunContext& context) const {
  TriangleTree tree = *this;
  tree.place(points, context);
  return tree;
}

}  // namespace deform
