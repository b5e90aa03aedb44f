#pragma once

namespace deform {

enum class DenseSolver {
  automatic,  ///< Cholesky, with LDL^T as the fallback when it breaks down
  cholesky,   ///< on the complement of the polynomials
  ldlt,       ///< Bunch-Kaufman (dsytrf) of the bordered system
  lu,         ///< dgetrf of the bordered system; for comparison
};

const char* to_string(DenseSolver solver);

}  // namespace deform
