// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace deform::quality {

/// What is known about two nodes: they are on the same side where the weight is positive, on opposite ones where it is negative;
/// the more, the larger it is.
struct SidePair {
  std::uint32_t first = 0, second = 0;
  std::uint32_t order = 0;  ///< unlike that of all others: of two equal weights that with the lower order counts first
  double weight = 0;
};

struct TwoSides {
  std::vector<char> side;                ///< per node 0 or 1
  std::vector<std::uint32_t> component;  ///< per node: the same number where pairs connect; below the number of nodes
};

/// Puts the nodes of a graph on two sides so that the pairs are contradicted by little. Finding the least is hard (it is that of
/// a spin glass); here clusters join in rounds, each with the neighbour about which their common pairs say the most in sum, so
/// that many pairs outvote few. Where no circle of pairs contradicts itself, no pair is contradicted. The result depends on the
/// orders and weights, not on how the nodes are numbered or the pairs are sorted. Time: that of sorting the pairs, a few times.
TwoSides two_sides(std::size_t nodes, std::vector<SidePair> pairs);

}  // namespace deform::quality
