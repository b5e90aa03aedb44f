// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "core/constraints/constraint.h"
#include "tests/core/deformers/dense_energy.h"

/// Stationary points of an energy with soft geometric constraints, to rounding of extended precision: shapes are fitted by
/// decompositions, their derivatives are differences, and Newton's equations are dense.
namespace deform::test::dense_energy {

using Place = Eigen::Matrix<Extended, 3, 1>;
using Places = std::vector<Place>;

Place mean_of(const Places& x);

/// The radius or angle that a kind keeps of its points at rest.
using Kept = std::optional<Extended>;

/// A circle, an infinite cylinder, or a cone far from its apex: its radius grows along the axis by the tangent of the angle.
struct Round {
  Place centre = Place::Zero(), axis = Place::Zero();
  Extended radius = 0, angle = 0;
};

/// What the kinds of round shapes leave free.
struct RoundKind {
  bool circle = false, cone = false;
  bool keeps = false;  ///< its radius, or of a cone its angle

  explicit RoundKind(const ConstraintKind& kind);
  bool free_radius() const { return cone || !keeps; }
  bool free_angle() const { return cone && !keeps; }
};
bool is_round(const ConstraintKind& kind);

/// The nearest one of all with the geometric distance, by Gauss and Newton's method from `start`, halving steps.
class RoundFit {
 public:
  RoundFit(const ConstraintKind& kind, const Places& x, const Kept& kept) : kind_(kind), kept_(kept), x_(x) {}

  Extended squares(const Round& at) const;

  Round improved(Round at) const;

  Places nearest(const Round& at) const;

  /// From principal axes and, of a cylinder or cone, directions all around, with the algebraic circle across each; the best.
  Round best() const;

 private:
  /// The changes of the centre along `first`, `second` and the axis, of the axis along the two, of radius and angle; zero where
  /// the kind has none.
  Matrix step_at(const Round& at, const Place& first, const Place& second) const;

  const RoundKind kind_;
  const Kept kept_;
  const Places& x_;
};

/// What a kind keeps of its points at rest.
Kept kept_of(const ConstraintKind& kind, const Places& rest);

/// The nearest places of that kind with what it keeps. `near`, of round shapes, is one from which the fit starts, or where that
/// of the best of several is stored.
Places projected(const ConstraintKind& kind, const Kept& kept, const Places& rest, const Places& x, const Place& origin,
                 std::optional<Round>* near = nullptr);

/// One constraint.
struct Set {
  ConstraintKind kind;
  std::vector<std::vector<std::pair<Eigen::Index, double>>> rows;  ///< functions at its points
  Places rest;
  Place origin = Place::Zero();       ///< what has been subtracted from places
  Extended weight = 0;                ///< of each point
  mutable std::optional<Round> last;  ///< circle or cylinder of the last projection, from which the next one starts
  Places shift;                       ///< displacements that no function has, of held points; may be empty
  Kept kept{};                        ///< kept_of() its kind and rest

  Places at(const Field& w) const;
  Places projected(const Places& x) const { return dense_energy::projected(kind, kept, rest, x, origin, &last); }
  /// Adds weight Phi^T v.
  void add_transposed(const Places& v, Field& to) const;
  /// I - P' at x, by differences.
  Matrix residual_derivative(const Places& x) const;
};

/// Newton's method for  A w + sum weight Phi^T (x - P(x)) = b, once or, with multipliers, after each of
/// their steps with what the last one has left.
class ConstrainedEquations {
 public:
  ConstrainedEquations(const Equations& equations, const std::vector<Set>& sets, bool multipliers)
      : equations_(equations), sets_(sets), multipliers_(multipliers), factor_(equations) {}

  struct Solution {
    Field w;
    Extended rounding = 0;  ///< what the steps end at: of shapes that the points hardly determine
  };

  /// From places of the sets near their solution; without w if the steps do not end.
  Solution solution(const std::vector<Places>& near);

 private:
  /// False if the steps do not end.
  bool improve(Solution& result) const;

  Field residual(const Field& w) const;

  static Field solved(const Lu<Extended>& lu, const Field& r);

  /// Every point drawn to the shape that the places near the solution have; with multipliers, where these are not the solver's,
  /// which lacks what is interpolated, some more times to those that its points then have.
  Field start(std::vector<Places> near) const;
  Field drawn(const Lu<Extended>& lu, const std::vector<Places>& near) const;

  Matrix derivative(const Field& w) const;

  /// The same matrix for every coordinate.
  static Matrix spread(const Matrix& one);

  static void add(const Set& set, const Matrix& D, Matrix& A);

  const Equations& equations_;
  const std::vector<Set>& sets_;
  const bool multipliers_;
  const Factor factor_;
  Field b_;
};

}  // namespace deform::test::dense_energy
