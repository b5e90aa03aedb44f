// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>
#include <cstddef>
#include <span>

#include "core/constraints/projection.h"

namespace deform {

/// The form of the Gauss-Newton matrix of ConstrainedSolver.
enum class NewtonForm {
  none,    ///< none can be afforded
  forces,  ///< in the forces of the shapes: one unknown per linearized distance
  full,    ///< in the coefficients, full
  sparse,  ///< in the coefficients
};

/// Most unknowns of the full forms; most operations of a step.
inline constexpr std::size_t most_forces = 6000, most_full = 6000;
inline constexpr double affordable_newton = 4e11;
inline constexpr double affordable_compliance = 1e11;  ///< operations to prepare the form in forces
inline constexpr double solution_cost = 4;             ///< operations per entry of a factor
/// A sparse Newton matrix has three unknowns per function of the global step's.
inline constexpr double sparse_newton_cost = 27;

/// What the choice of one depends on: counts, not times, so that it is the same everywhere.
struct NewtonSizes {
  std::size_t points = 0;        ///< N, of all sets
  std::size_t rows = 0;          ///< linearized distances
  std::size_t touched = 0;       ///< points of these, one or two each
  std::size_t parameters = 0;    ///< of the shapes
  std::size_t jacobian = 0;      ///< entries of the distances by the parameters
  std::size_t functions = 0;     ///< r
  bool dense = false;            ///< ReducedEnergy::dense()
  std::size_t factor_bytes = 0;  ///< of the matrix of the global step
  double factor_operations = 0;  ///< of factoring it

  /// A set: its distances at rest are as many as anywhere.
  void add(const Projection& projection, std::span<const Vec3> rest);
};

struct NewtonChoice {
  NewtonForm form = NewtonForm::none;
  double operations = HUGE_VAL;  ///< of a step
};

/// The form that takes the fewest operations of those that are affordable and take up to half of `memory_limit` (bytes, 0 =
/// unlimited; counts for the form in forces, which has full matrices of any number of points).
NewtonChoice cheapest_newton(const NewtonSizes& sizes, std::size_t memory_limit);

}  // namespace deform
