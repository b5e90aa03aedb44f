// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/solver.h"

namespace deform {

namespace {

constexpr std::size_t most_dense = 20000;  // centres that `automatic` factors: 1.6 GB and half a minute

}  // namespace

Solver chosen_solver(Solver solver, Kernel kernel, std::size_t centres) {
  if (solver != Solver::automatic) return solver;
  return centres > most_dense && properties(kernel).smooth ? Solver::iterative : Solver::cholesky;
}

const char* to_string(Solver solver) {
  switch (solver) {
    case Solver::automatic:
      return "automatic";
    case Solver::cholesky:
      return "cholesky";
    case Solver::ldlt:
      return "ldlt";
    case Solver::iterative:
      return "iterative";
    case Solver::incremental_qr:
      return "incremental QR";
  }
  return "automatic";
}

}  // namespace deform
