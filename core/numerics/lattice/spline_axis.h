// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace deform {

/// The functions along each axis of a lattice.
enum class LatticeBasis {
  uniform_cubic,  ///< cubic B-splines, uniform knots (thesis 3.2): the first and last control point lie one span outside
  clamped_cubic,  ///< cubic B-splines, knots four-fold at the ends: the first and last control point lie on them
  bernstein,      ///< of degree points - 1: every control point moves everything (Sederberg, Parry 1986)
};

/// B-splines N_0 .. N_{size - 1} on [0, 1] (de Boor 1978; recurrences as in Piegl, Tiller, The NURBS Book, 2.2 to 2.5). They are
/// not negative, add up to 1, and sum_i greville(i) N_i(u) = u. Immutable; any thread.
class SplineAxis {
 public:
  static constexpr std::size_t least_points = 4, most_bernstein_points = 16;
  /// Functions that are not zero at one place, at most.
  static constexpr std::size_t most_order = most_bernstein_points;

  /// points: at least 4 for the cubic bases, 2 to 16 for bernstein. Throws Error(invalid_argument).
  SplineAxis(LatticeBasis basis, std::size_t points);

  std::size_t size() const { return points_; }
  std::size_t degree() const { return degree_; }
  /// Functions that are not zero in a span: degree + 1.
  std::size_t order() const { return degree_ + 1; }
  std::size_t spans() const { return points_ - degree_; }
  /// Knot k of size + degree + 1; N_i is not zero between knots i and i + degree + 1.
  double knot(std::size_t k) const { return knots_[k]; }
  /// Mean of the inner knots of N_i: its coefficient of the function u.
  double greville(std::size_t i) const;
  /// The span that u (in [0, 1]) lies in, which is also the first function that is not zero there.
  std::size_t span(double u) const;
  /// out[0 .. order - 1]: the derivative of that order (0: the value, at most the degree) of N_{span} .. N_{span + degree} at u.
  void evaluate(std::size_t span, double u, std::size_t derivative, double* out) const;
  /// G_ij = integral over [0, 1] of the p-th derivative of N_i times the q-th of N_j: size x size, exact but for rounding.
  Eigen::MatrixXd gram(std::size_t p, std::size_t q) const;

 private:
  std::size_t points_, degree_;
  std::vector<double> knots_;  ///< points + degree + 1
};

/// Nodes and weights of the Gauss-Legendre rule on [0, 1], exact for polynomials of degree 2 count - 1.
struct GaussRule {
  std::vector<double> nodes, weights;
};
GaussRule gauss_rule(std::size_t count);

}  // namespace deform
