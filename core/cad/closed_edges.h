// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/cad/correspondence.h"
#include "core/cad/model.h"

namespace deform::cad {

/// Where closed edges start on a partner whose start says nothing: it lies where a CAD program put the seam of a cylinder or the
/// like.
struct ClosedEdges {
  std::vector<double>
      phases;  ///< of each old edge: the start goes to this fraction of its partner, in its own sense; 0: to the start
  std::vector<char> loose;      ///< of each old edge, 1: a seam that does not go to its partner, since the edges at its ends turn
  std::vector<int> start_edge;  ///< of each old vertex: the turned closed edge that starts there; -1: a vertex as any other
};

/// Compares closed edges with their partners point by point, after the similarity that fits the models best and the least
/// rotation between both means of the normals. A start stays a start where that differs by less than 1/50 of the way round, where
/// it is more than the end of seams of periodic surfaces, on faces without other edges, as whole spheres and tori, and
/// where both models have the same parameters.
ClosedEdges closed_edges(const Model& before, const Model& after, const Correspondence& partners);

}  // namespace deform::cad
