// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained/constrained_points.h"

namespace deform {

/// Upper bounds in bytes of the memory of a ConstrainedSolver besides that of the EnergySolver, known before it is constructed.
struct ConstrainedBytes {
  std::size_t resident = 0;   ///< ConstrainedSolver::bytes()
  std::size_t preparing = 0;  ///< peak during construction, including `resident`
  std::size_t working = 0;    ///< for one design or derivative, with a Newton step
  double operations = 0;      ///< floating-point operations of the factorizations
  double seconds = 0;         ///< besides these operations
  /// Seconds for the solution of one design, besides solutions with the factor of the EnergySolver. Rough: the iterations are
  /// those that designs mostly take.
  double design_seconds = 0;
};

/// The bounds from the lower triangle of the matrix that the solver factors and the values at all points. Uses symbolic analysis,
/// accurate to a few percent. Between two analyses the context may stop it.
/// `delivered` may be null; else it has its functions and points.
ConstrainedBytes constrained_bytes(const SparseMatrix& matrix, const FunctionRows& values, const std::vector<ConstraintSet>& sets,
                                   const DeliveredRows* delivered = nullptr, const RunContext& context = {});

/// Upper bounds of the counts of a space that is not built yet.
struct SpaceCounts {
  std::size_t functions = 0;
  std::size_t cover = 0;           ///< functions that are nonzero at a point
  std::size_t energy_entries = 0;  ///< entries of the lower triangle of the matrix
  std::size_t factor_entries = 0;
  std::size_t reaching = std::numeric_limits<std::size_t>::max();  ///< functions that are nonzero at a point of the sets
  std::size_t delivered = 0;  ///< of DeliveredRows: points of the sets that follow functions; 0 without them
};
/// The bounds for any functions that reach the sets and any form of Newton's matrix.
ConstrainedBytes constrained_bytes(const SpaceCounts& space, const std::vector<ConstraintSet>& sets);

}  // namespace deform
