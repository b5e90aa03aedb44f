// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/base/vectors.h"

namespace deform {

/// A place on a triangle: its number, barycentric weights of its corners and the place itself.
struct PlaceOnTriangle {
  static constexpr std::uint32_t none = ~std::uint32_t{0};    ///< no triangle
  std::uint32_t triangle = none;                              ///< number of the triangle
  std::array<double, 3> weights{};                            ///< barycentric, of its corners
  Vec3 point{};                                               ///< the place
  double distance = std::numeric_limits<double>::infinity();  ///< from where was asked; squared of nearest places

  bool found() const { return triangle != none; }  ///< whether there is one
};

/// The place of a triangle that is nearest to x, with the squared distance (C. Ericson, Real-Time Collision Detection, 2005,
/// 5.1.5). The triangle may be degenerate.
PlaceOnTriangle nearest_on_triangle(const std::array<Vec3, 3>& corners, const Vec3& x);

/// A ray, prepared for many triangles (S. Woop, C. Benthin, I. Wald, Watertight ray/triangle intersection, JCGT 2(1), 2013): a
/// ray through an edge or corner meets at least one of the triangles around it.
class Ray {
 public:
  /// direction: not zero.
  Ray(const Vec3& origin, const Vec3& direction);

  /// Where the ray meets the triangle, with the distance in lengths of the direction, at least 0.
  PlaceOnTriangle meet(const std::array<Vec3, 3>& corners) const;
  /// Whether it may meet the box before `nearest`; boxes that it touches count.
  bool meets(const Box& box, double nearest) const;

 private:
  Vec3 origin_, direction_, inverse_;
  std::array<std::size_t, 3> axes_;
  Vec3 shear_;
};

/// Which nodes of a tree may hold a triangle whose normal is near to a direction, by cones around the normals of each node.
class NormalCones {
 public:
  NormalCones() = default;

  /// Whether node `index` may hold a triangle with a normal n such that n.u is at least the least cosine; u is a unit vector.
  bool may_hold(std::size_t index, const Vec3& u) const { return dot(axes_[index], u) >= least_[index]; }

 private:
  friend class TriangleTree;
  std::vector<Vec3> axes_;
  std::vector<double> least_;  ///< cosine of the angle to the axis up to which there may be one; -2: any
};

/// A tree of bounding boxes over triangles, which can be placed anew when their corners move. Immutable; any number of threads.
class TriangleTree {
 public:
  TriangleTree() = default;
  /// triangles: corners of each, of which it keeps a copy; points: what they number. Throws the errors of RunContext::check().
  TriangleTree(std::span<const std::array<PointId, 3>> triangles, std::span<const Vec3> points, const RunContext& context = {});

  /// The same tree around other points.
  TriangleTree moved(std::span<const Vec3> points, const RunContext& context) const;

  /// The cones of unit normals, one of each triangle or 0, for the least cosine to a direction, of an angle from 0 to 90 degrees.
  NormalCones cones(std::span<const Vec3> normals, double least_cosine, const RunContext& context) const;

  /// The nearest place closer than the root of `squared_limit` on triangles for which accept(number) holds. Of equally close
  /// triangles the one with the least number.
  template <typename Accept>
  PlaceOnTriangle nearest(const Vec3& x, double squared_limit, const Accept& accept) const {
    return nearest(x, squared_limit, accept, [](std::uint32_t) { return true; });
  }
  /// enter(node): false for nodes that hold no such triangle, which are passed over.
  template <typename Accept, typename Enter>
  PlaceOnTriangle nearest(const Vec3& x, double squared_limit, const Accept& accept, const Enter& enter) const;
  /// The first place of a ray on triangles for which accept(number) holds. Of several at the same distance that with the least
  /// number.
  template <typename Accept>
  PlaceOnTriangle first(const Ray& ray, const Accept& accept) const;
  /// Calls visit(number) for all triangles whose bounding boxes meet `box`, touching it included, until it returns false.
  template <typename Visit>
  void meeting(const Box& box, const Visit& visit) const;

  /// An upper bound of the memory in bytes for this number of triangles.
  static std::size_t bytes_for(std::size_t triangles) {
    return triangles *
           (sizeof(std::array<PointId, 3>) + sizeof(std::uint32_t) + sizeof(std::array<Vec3, 3>) + sizeof(Node) + sizeof(Box));
  }

 private:
  static constexpr std::uint32_t leaf_size = 4, triangles_without_check = 4096;
  static constexpr std::size_t most_open = 64;  ///< a halved list of 2^32 has 32 levels
  struct Node {
    std::uint32_t begin = 0, end = 0;
    std::uint32_t right = 0;  ///< the second child, the first one is next; 0: a leaf
  };

  std::uint32_t build(std::uint32_t begin, std::uint32_t end, const RunContext& context);
  void place(std::span<const Vec3> points, const RunContext& context);
  static double squared_distance_to(const Box& box, const Vec3& x);
  static bool meet(const Box& a, const Box& b) {
    return a.min[0] <= b.max[0] && b.min[0] <= a.max[0] && a.min[1] <= b.max[1] && b.min[1] <= a.max[1] && a.min[2] <= b.max[2] &&
           b.min[2] <= a.max[2];
  }

  std::vector<std::array<PointId, 3>> triangles_;
  std::vector<std::uint32_t> order_;          ///< numbers of triangles, leaf by leaf
  std::vector<std::array<Vec3, 3>> corners_;  ///< in that order
  std::vector<Node> nodes_;
  std::vector<Box> boxes_;  ///< of nodes
};

inline double TriangleTree::squared_distance_to(const Box& box, const Vec3& x) {
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const double outside = std::max({box.min[k] - x[k], x[k] - box.max[k], 0.0});
    sum += outside * outside;
  }
  return sum;
}

template <typename Accept, typename Enter>
PlaceOnTriangle TriangleTree::nearest(const Vec3& x, double squared_limit, const Accept& accept, const Enter& enter) const {
  PlaceOnTriangle best;
  if (nodes_.empty()) return best;
  double least = squared_limit;
  std::array<std::uint32_t, most_open> open{};
  std::size_t count = 1;
  while (count > 0) {
    const std::uint32_t index = open[--count];
    const Node& node = nodes_[index];
    if (squared_distance_to(boxes_[index], x) > least || !enter(index)) continue;
    if (node.right == 0) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        if (!accept(order_[i])) continue;
        const PlaceOnTriangle place = nearest_on_triangle(corners_[i], x);
        if (place.distance < least || (place.distance == least && best.found() && order_[i] < best.triangle)) {
          least = place.distance;
          best = place;
          best.triangle = order_[i];
        }
      }
      continue;
    }
    const std::uint32_t left = index + 1;
    const bool right_first = squared_distance_to(boxes_[node.right], x) < squared_distance_to(boxes_[left], x);
    open[count++] = right_first ? left : node.right;
    open[count++] = right_first ? node.right : left;
  }
  return best;
}

template <typename Accept>
PlaceOnTriangle TriangleTree::first(const Ray& ray, const Accept& accept) const {
  PlaceOnTriangle best;
  if (nodes_.empty()) return best;
  std::array<std::uint32_t, most_open> open{};
  std::size_t count = 1;
  while (count > 0) {
    const std::uint32_t index = open[--count];
    const Node& node = nodes_[index];
    if (!ray.meets(boxes_[index], best.distance)) continue;
    if (node.right == 0) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        if (!accept(order_[i])) continue;
        const PlaceOnTriangle place = ray.meet(corners_[i]);
        if (place.distance < best.distance || (place.distance == best.distance && best.found() && order_[i] < best.triangle)) {
          best = place;
          best.triangle = order_[i];
        }
      }
      continue;
    }
    open[count++] = node.right;
    open[count++] = index + 1;
  }
  return best;
}

template <typename Visit>
void TriangleTree::meeting(const Box& box, const Visit& visit) const {
  if (nodes_.empty()) return;
  std::array<std::uint32_t, most_open> open{};
  std::size_t count = 1;
  while (count > 0) {
    const std::uint32_t index = open[--count];
    const Node& node = nodes_[index];
    if (!meet(boxes_[index], box)) continue;
    if (node.right != 0) {
      open[count++] = node.right;
      open[count++] = index + 1;
      continue;
    }
    for (std::uint32_t i = node.begin; i < node.end; ++i) {
      Box own;
      for (const Vec3& corner : corners_[i]) own.add(corner);
      if (meet(own, box) && !visit(order_[i])) return;
    }
  }
}

}  // namespace deform
