// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "core/base/types.h"
#include "core/mesh/adjacency.h"

namespace deform {

/// Counts the faces along one edge at a point. Faces with fewer than three corners have no edges, and neither has a corner that
/// repeats its predecessor.
struct EdgeUse {
  PointId other = 0;           ///< the other end point
  std::uint32_t outgoing = 0;  ///< faces that traverse the edge from the point to `other`
  std::uint32_t incoming = 0;  ///< faces that traverse it from `other` to the point

  std::uint32_t faces() const { return outgoing + incoming; }
};

/// Stores the edges at `point`, ascending by `other`, in `edges`, which is cleared first so that a loop over points reuses
/// its memory.
void edge_uses(const Adjacency& adjacency, PointId point, std::vector<EdgeUse>& edges);

}  // namespace deform
