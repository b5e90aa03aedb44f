// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <vector>

#include "core/deformers/constrained/constrained_points.h"

namespace deform {

/// What a ConstrainedSolver takes beside the EnergySolver, before it is made. Bytes, at most.
struct ConstrainedBytes {
  std::size_t resident = 0;   ///< ConstrainedSolver::bytes()
  std::size_t preparing = 0;  ///< while it is made, with what stays
  std::size_t working = 0;    ///< of one design or derivative, with a Newton step
  double operations = 0;      ///< of the factorizations
};

/// From the lower triangle of the matrix that the solver factors and the values at all points: by symbolic analysis, to a few
/// percent.
ConstrainedBytes constrained_bytes(const SparseMatrix& matrix, const FunctionRows& values,
                                   const std::vector<ConstraintSet>& sets);

/// Of a space that is not there yet; every count at most.
struct SpaceCounts {
  std::size_t functions = 0;
  std::size_t cover = 0;           ///< functions that reach a point
  std::size_t energy_entries = 0;  ///< of the lower triangle of the matrix
  std::size_t factor_entries = 0;
};
/// Whatever functions reach the sets, whichever form Newton's matrix takes.
ConstrainedBytes constrained_bytes(const SpaceCounts& space, const std::vector<ConstraintSet>& sets);

}  // namespace deform
