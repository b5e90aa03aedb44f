#pragma once

namespace deform {

enum class Solver {
  automatic,        ///< Cholesky, with LDL^T as the fallback when it breaks down; iterative beyond 20,000 centres
  cholesky,         ///< on the complement of the polynomials
  ldlt,             ///< Bunch-Kaufman (dsytrf) of the bordered system
  lu,               ///< dgetrf of the bordered system; for comparison
  iterative,        ///< GMRES with domain decomposition and fast sums: to a tolerance, memory linear in the number of centres
  sparse_cholesky,  ///< CHOLMOD: what the energy methods (shell, subspace, MLS) use; never asked for
};

const char* to_string(Solver solver);

}  // namespace deform
