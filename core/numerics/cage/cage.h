// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// A control cage (thesis 3.4): a closed triangle mesh, usually coarse, around a model or a part of it. Its edges are shared by
/// two triangles each, which run along them in opposite directions; it may have several components, handles and cavities.
/// Triangles that face inwards as a whole are turned round. Whether it intersects itself is not looked at.
///
/// What is computed in it works in coordinates of its own: divided by a power of two near the diagonal of the cage, from the
/// middle of its box, so that tolerances do not depend on units. Immutable; any thread.
class Cage {
 public:
  using Triangle = std::array<std::uint32_t, 3>;
  /// Vertices that a cage may have.
  static constexpr std::size_t most_vertices = 10000;
  /// Least altitude of a triangle over the diagonal of the cage: below, it has no plane.
  static constexpr double least_altitude = 1e-9;

  /// Throws Error(invalid_argument) naming vertex, triangle or edge, each message beginning with "vertices" or "triangles": fewer
  /// than 4 or more than most_vertices vertices, one that is not finite, one that no triangle has or whose triangles are not one
  /// fan; a corner that is out of range or repeated, a triangle that is degenerate, an edge with another number of triangles than
  /// two, or along which both run in the same direction; no volume.
  Cage(std::vector<Vec3> vertices, std::vector<Triangle> triangles);

  /// Model units, as given.
  const std::vector<Vec3>& vertices() const { return vertices_; }
  /// Facing outwards.
  const std::vector<Triangle>& triangles() const { return triangles_; }
  std::size_t size() const { return vertices_.size(); }
  /// The diagonal of its box, model units.
  double diagonal() const { return diagonal_; }
  std::size_t bytes() const;
  /// Upper bound of bytes().
  static std::size_t bytes_for(std::size_t vertices, std::size_t triangles);

  /// The coordinates of the cage: x = middle + scale * place.
  Vec3 place(const Vec3& x) const;
  double scale() const { return scale_; }
  const std::vector<Vec3>& places() const { return places_; }

  struct Edge {
    std::array<std::uint32_t, 2> ends{};
    Vec3 along{};  ///< unit vector from the first end to the second
    double length = 0;
  };
  const std::vector<Edge>& edges() const { return edges_; }

  /// The plane of a triangle. Side k is opposite to corner k, from corner k + 1 to corner k + 2.
  struct Face {
    Triangle corners{};
    std::array<std::uint32_t, 3> sides{};  ///< edges
    Vec3 normal{};                         ///< outwards, unit length
    std::array<Vec3, 3> inwards{};         ///< in the plane, normal to the sides, unit length
    std::array<double, 3> altitudes{};     ///< of the corners over the sides
  };
  const std::vector<Face>& faces() const { return faces_; }

 private:
  void check_vertices() const;
  void find_edges();
  void check_fans() const;
  void find_faces();

  std::vector<Vec3> vertices_;
  std::vector<Triangle> triangles_;
  double diagonal_ = 0, scale_ = 1;
  Vec3 middle_{};
  std::vector<Vec3> places_;
  std::vector<Edge> edges_;
  std::vector<Face> faces_;
};

/// A point seen from the plane of a triangle: its signed height over the plane (below it, inside a convex cage, over 0), and the
/// distances of its foot from the lines of the sides, over 0 on the side of the triangle. `to`: from the point to each vertex.
struct FaceView {
  double height = 0;
  std::array<double, 3> from_sides{};
};
FaceView view_of(const Cage::Face& face, std::span<const Vec3> to, std::span<const double> distances);

}  // namespace deform
