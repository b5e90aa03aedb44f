// SPDX-License-Identifier: GPL-3.0-or-later
// Green coordinates by quadrature of their definition, in long double.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>
#include <vector>

#include "core/numerics/cage/cage.h"
#include "core/numerics/lattice/spline_axis.h"

namespace deform::test {

class GreenQuadrature {
 public:
  /// The coordinates for the vertices and for the triangles.
  struct Coordinates {
    std::vector<double> phi, psi;
  };

  explicit GreenQuadrature(const Cage& cage) : cage_(cage) {}

  Coordinates at(const Vec3& x) const {
    Coordinates result{std::vector<double>(cage_.size(), 0.0), {}};
    std::vector<Real> phi(cage_.size(), 0);
    for (const Cage::Triangle& triangle : cage_.triangles()) {
      Piece piece;
      for (std::size_t k = 0; k < 3; ++k) {
        for (std::size_t i = 0; i < 3; ++i) piece.corners[k][i] = Real(cage_.vertices()[triangle[k]][i]) - Real(x[i]);
        piece.hats[k][k] = 1;
      }
      const Real flux =
          inner(piece.corners[0], crossed(minus(piece.corners[1], piece.corners[0]), minus(piece.corners[2], piece.corners[0])));
      std::array<Real, 4> sums{};
      add(piece, flux, sums, 0);
      for (std::size_t k = 0; k < 3; ++k) phi[triangle[k]] += sums[k];
      result.psi.push_back(static_cast<double>(sums[3]));
    }
    for (std::size_t i = 0; i < phi.size(); ++i) result.phi[i] = static_cast<double>(phi[i]);
    return result;
  }

 private:
  using Real = long double;
  using Vector = std::array<Real, 3>;
  struct Piece {
    std::array<Vector, 3> corners{};  ///< from x
    std::array<Vector, 3> hats{};     ///< values of the hat functions there
  };

  static Real inner(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
  static Vector minus(const Vector& a, const Vector& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
  static Vector crossed(const Vector& a, const Vector& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  }
  static Vector between(const Vector& a, const Vector& b, Real t) {
    return {a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])};
  }

  /// The integrals of hat n . y / |y|^3 and 1 / |y| over a piece, over 4 pi. `flux` is n . y times twice the area of the piece.
  /// Pieces near x are cut in four.
  static void add(const Piece& piece, Real flux, std::array<Real, 4>& sums, int depth) {
    Real size = 0, nearest = 1e300L;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector side = minus(piece.corners[(k + 1) % 3], piece.corners[k]);
      size = std::max(size, std::sqrt(inner(side, side)));
      nearest = std::min(nearest, std::sqrt(inner(piece.corners[k], piece.corners[k])));
    }
    if (size > 0.4L * (nearest - 0.5L * size) && depth < 60) {
      Piece middle;
      for (std::size_t k = 0; k < 3; ++k) {
        middle.corners[k] = between(piece.corners[(k + 1) % 3], piece.corners[(k + 2) % 3], 0.5L);
        middle.hats[k] = between(piece.hats[(k + 1) % 3], piece.hats[(k + 2) % 3], 0.5L);
      }
      add(middle, flux / 4, sums, depth + 1);
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t l = (k + 1) % 3, m = (k + 2) % 3;
        add({{piece.corners[k], middle.corners[m], middle.corners[l]}, {piece.hats[k], middle.hats[m], middle.hats[l]}}, flux / 4,
            sums, depth + 1);
      }
      return;
    }
    constexpr std::size_t nodes = 8;
    static const GaussRule rule = gauss_rule(nodes);
    const Vector across = crossed(minus(piece.corners[1], piece.corners[0]), minus(piece.corners[2], piece.corners[0]));
    const Real twice = std::sqrt(inner(across, across));
    for (std::size_t i = 0; i < nodes; ++i) {
      for (std::size_t j = 0; j < nodes; ++j) {
        const Real u = rule.nodes[i], v = rule.nodes[j];
        const Real weight = Real(rule.weights[i]) * Real(rule.weights[j]) * u / (4 * std::numbers::pi_v<Real>);
        const Vector y = between(piece.corners[0], between(piece.corners[1], piece.corners[2], v), u);
        const Vector hat = between(piece.hats[0], between(piece.hats[1], piece.hats[2], v), u);
        const Real r = std::sqrt(inner(y, y));
        for (std::size_t k = 0; k < 3; ++k) sums[k] += weight * flux * hat[k] / (r * r * r);
        sums[3] += weight * twice / r;
      }
    }
  }

  const Cage& cage_;
};

}  // namespace deform::test
