// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "core/base/types.h"
#include "core/mesh/adjacency.h"

namespace deform {

/// One edge at a point: how often faces run along it. A face of fewer than three corners has no edges, nor has a corner that
/// repeats its predecessor.
struct EdgeUse {
  PointId other = 0;           ///< the other end point
  std::uint32_t outgoing = 0;  ///< faces that run from the point to `other`
  std::uint32_t incoming = 0;  ///< faces that run from `other` to the point

  std::uint32_t faces() const { return outgoing + incoming; }
};

/// The edges at `point`, ascending by `other`, into `edges` (cleared first, so that a loop over points reuses its memory).
void edge_uses(const Adjacency& adjacency, PointId point, std::vector<EdgeUse>& edges);

}  // namespace deform
