// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>

#include "core/numerics/kernels/kernel.h"

namespace deform {

enum class Solver {
  automatic,  ///< Cholesky with LDL^T as fallback if it breaks down; iterative beyond 20,000 centres
  cholesky,   ///< dense Cholesky on the complement of the polynomials
  ldlt,       ///< dense Bunch-Kaufman factorization (dsytrf) of the bordered system
  iterative,  ///< GMRES with domain decomposition and fast sums, to a tolerance; memory linear in the number of centres
  /// Least squares over all constraint points, with as many of them as centres as the tolerance requires (thesis 7.5). Smooth
  /// motions need few centres, which makes evaluation cheap. At most most_incremental_centres centres.
  incremental_qr,
};

/// Limits the time and memory of incremental_qr: it stores 8 bytes per centre and constraint point.
inline constexpr int most_incremental_centres = 4000;

/// Whether the solver works to the tolerance of a request, rather than to rounding.
constexpr bool to_tolerance(Solver solver) { return solver == Solver::iterative || solver == Solver::incremental_qr; }

/// Resolves `automatic`; other solvers are returned unchanged. Cholesky still has its fallback then.
Solver chosen_solver(Solver solver, Kernel kernel, std::size_t centres);

const char* to_string(Solver solver);

/// The order in which constraint points become centres of incremental_qr.
enum class CentreOrder {
  farthest_point,  ///< farthest from the preceding ones: evenly spread, independent of the values
  greedy,          ///< largest error of the sample values (thesis 4.5): for values like the samples, narrow features
};

}  // namespace deform
