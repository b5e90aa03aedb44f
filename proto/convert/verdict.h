// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "deform/v1/deformation.pb.h"

namespace deform::convert {

/// The facts on which a verdict depends besides the result of a design.
struct SolutionFacts {
  double diagonal = 0;         ///< diagonal of the bounding box at rest, model units
  double condition = 0;        ///< condition number of the factored matrix; 0 = not estimated
  bool converged = true;       ///< DesignReport::converged
  std::size_t torn_edges = 0;  ///< DesignReport::torn_edges
  double misfit = 0;           ///< DesignReport::misfit, model units: of direct manipulation
};

/// Sets the verdict and its reasons from all other fields of `result`; see v1::Verdict.
void set_verdict(const SolutionFacts& facts, v1::DesignResult& result);

}  // namespace deform::convert
