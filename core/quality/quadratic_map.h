// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/elements.h"

namespace deform {

/// The map from the reference element of a quadratic type to space that its nodes define: linear combinations of
///   x^i y^j z^k  of degree 2                                              tetrahedron10
///   x^i y^j z^k, i + j <= 2 and k <= 2 (prism15: k < 2 where i + j > 1)    prism18, prism15
///   x^i y^j z^k, each <= 2 (hexahedron20: at most one of them 2)          hexahedron27, hexahedron20
///   those of degree 2, w, w x, w y and w^2 with w = x y / (1 - z)         pyramid14; pyramid13 without w^2
/// that are 1 at one node and 0 at the others: the serendipity and Lagrange elements of textbooks (Zienkiewicz, Taylor, The
/// Finite Element Method, chapter 8), for pyramids those of Bedrosian (1992), also Bergot, Cohen, Durufle (2010), which agree
/// with their neighbours on faces. Immutable.
class QuadraticMap {
 public:
  /// Derivatives of every shape function at a point of the reference element: nodes x 3.
  using Gradients = std::vector<Vec3>;
  /// A node at which the Jacobian is evaluated along the directions of the edges of some corner: at corners their own edges, at
  /// other nodes the edges of each corner. At a pyramid's apex, where derivatives depend on the direction of approach, the limit
  /// along its axis is taken.
  struct Sample {
    Gradients gradients;
    std::vector<std::array<Vec3, 3>> frames;  ///< directions in the reference element
  };
  struct QuadraturePoint {
    Gradients gradients;
    double weight;
  };

  /// The map of a quadratic element type, created on first use.
  static const QuadraticMap& of(ElementType type);

  const std::vector<Sample>& samples() const { return samples_; }  ///< one for each node
  /// 27 points, exact for the determinant: Gauss points of the cube, collapsed to the reference element. On the cube the map has
  /// degree 2 and the determinant degree 5 in each coordinate.
  const std::vector<QuadraturePoint>& quadrature() const { return quadrature_; }

 private:
  explicit QuadraticMap(ElementType type);

  std::vector<Sample> samples_;
  std::vector<QuadraturePoint> quadrature_;
};

/// The columns of the Jacobian at a point where the shape functions have these gradients.
std::array<Vec3, 3> jacobian(std::span<const Vec3> points, std::span<const PointId> nodes,
                             const QuadraticMap::Gradients& gradients);

}  // namespace deform
