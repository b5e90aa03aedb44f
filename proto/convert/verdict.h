// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "deform/v1/deformation.pb.h"

namespace deform::convert {

/// What a verdict takes into account besides the result of a design.
struct SolutionFacts {
  double diagonal = 0;         ///< of the bounding box at rest, model units
  double condition = 0;        ///< of the factored matrix; 0 = not estimated
  bool converged = true;       ///< DesignReport::converged
  std::size_t torn_edges = 0;  ///< DesignReport::torn_edges
};

/// From everything that `result` says, but for its verdict and reasons, sets these; see v1::Verdict.
void set_verdict(const SolutionFacts& facts, v1::DesignResult& result);

}  // namespace deform::convert
