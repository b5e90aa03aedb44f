// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>

#include "core/numerics/kernels/kernel.h"

namespace deform {

enum class Solver {
  automatic,  ///< Cholesky, with LDL^T as the fallback when it breaks down; iterative beyond 20,000 centres
  cholesky,   ///< on the complement of the polynomials
  ldlt,       ///< Bunch-Kaufman (dsytrf) of the bordered system
  iterative,  ///< GMRES with domain decomposition and fast sums: to a tolerance, memory linear in the number of centres
  /// Least squares over all constraint points with as many of them as centres as a tolerance needs (thesis 7.5): smooth motions
  /// need few, which makes evaluation cheap. At most most_incremental_centres.
  incremental_qr,
};

/// Bounds the memory of incremental_qr (8 bytes times this times the constraint points) and its time.
inline constexpr int most_incremental_centres = 4000;

/// Whether the solver delivers a tolerance that the request gives, instead of all digits.
constexpr bool to_tolerance(Solver solver) { return solver == Solver::iterative || solver == Solver::incremental_qr; }

/// What `automatic` stands for; Cholesky still has its fallback.
Solver chosen_solver(Solver solver, Kernel kernel, std::size_t centres);

const char* to_string(Solver solver);

/// In which order constraint points become centres of incremental_qr.
enum class CentreOrder {
  farthest_point,  ///< each is the one farthest from those before: the same whatever the values, evenly spread
  greedy,          ///< where the sample values are missed most (thesis 4.5): for values like the samples, narrow features
};

}  // namespace deform
