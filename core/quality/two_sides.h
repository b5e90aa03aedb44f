// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace deform::quality {

/// Evidence about two nodes: a positive weight says that they are on the same side, a negative one that they are on opposite
/// sides; its magnitude says how strong the evidence is.
struct SidePair {
  std::uint32_t first = 0, second = 0;
  std::uint32_t order = 0;  ///< unique; of two equal weights the pair of lower order counts first
  double weight = 0;
};

struct TwoSides {
  std::vector<char> side;                ///< 0 or 1 for each node
  std::vector<std::uint32_t> component;  ///< connected component of each node, a number below the number of nodes
};

/// Partitions the nodes of a graph into two sides such that the violated pairs have a small total weight. Finding the minimum is
/// NP-hard (the ground state of a spin glass); here clusters are merged in rounds, each with the neighbour for which the sum over
/// their common pairs is strongest, so that many pairs outvote few. If no cycle of pairs is contradictory, no pair is violated.
/// The result depends on orders and weights, but not on the numbering of the nodes or the order of `pairs`. Takes the time of
/// sorting the pairs a few times.
TwoSides two_sides(std::size_t nodes, std::vector<SidePair> pairs);

}  // namespace deform::quality
