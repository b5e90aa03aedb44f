// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>
#include <cstddef>
#include <span>

#include "core/constraints/projection.h"

namespace deform {

/// The form of the Gauss-Newton matrix of ConstrainedSolver.
enum class NewtonForm {
  none,    ///< all are too expensive
  forces,  ///< dense, in the forces of the shapes: one unknown per linearized distance
  full,    ///< dense, in the coefficients
  sparse,  ///< sparse, in the coefficients
};

/// The largest numbers of unknowns of the dense forms, and of operations of a step.
inline constexpr std::size_t most_forces = 6000, most_full = 6000;
inline constexpr double affordable_newton = 4e11;
inline constexpr double affordable_compliance = 1e11;  ///< operations to prepare the form in forces
inline constexpr double solution_cost = 4;             ///< operations per entry of a factor
/// A sparse Newton matrix has three unknowns for each function of the global step, so it costs 27 times as much.
inline constexpr double sparse_newton_cost = 27;

/// The counts on which the choice of a form depends. Counts, unlike times, give the same choice on every machine.
struct NewtonSizes {
  std::size_t points = 0;        ///< N, points of all sets
  std::size_t rows = 0;          ///< linearized distances
  std::size_t touched = 0;       ///< points of these distances, one or two each
  std::size_t parameters = 0;    ///< parameters of the shapes
  std::size_t jacobian = 0;      ///< entries of the derivative of the distances with respect to the parameters
  std::size_t functions = 0;     ///< r
  bool dense = false;            ///< ReducedEnergy::dense()
  std::size_t dense_points = 0;  ///< rows of V if all functions reach all points (DenseRows), else 0
  std::size_t factor_bytes = 0;  ///< factor of the matrix of the global step
  double factor_operations = 0;  ///< operations of this factorization

  /// Adds a set, with the distances at rest as a bound of their number.
  void add(const Projection& projection, std::span<const Vec3> rest);
};

struct NewtonChoice {
  NewtonForm form = NewtonForm::none;
  double operations = HUGE_VAL;  ///< operations of a step
};

/// The affordable form with the fewest operations. The form in forces, whose dense matrices grow with the number of points, must
/// take at most half of `memory_limit` (bytes, 0 = unlimited).
NewtonChoice cheapest_newton(const NewtonSizes& sizes, std::size_t memory_limit);

/// The iterations of the alternation that cost as much as a Newton matrix with so many operations, 4..150; 150 without one.
/// `factor_bytes`: of the factor of the global step. `entries`: of the values at the points of the sets.
int newton_patience(NewtonForm form, double operations, std::size_t factor_bytes, std::size_t entries);

}  // namespace deform
