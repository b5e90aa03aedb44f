// SPDX-License-Identifier: Apache-2.0
#include "core/quality/two_sides.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace deform::quality {

namespace {

/// Disjoint sets of nodes, each node on one of the two sides of its set.
class SidedSets {
 public:
  explicit SidedSets(std::size_t nodes) : parent_(nodes), side_(nodes, 0) {
    std::iota(parent_.begin(), parent_.end(), std::uint32_t{0});
  }

  struct Place {
    std::uint32_t root;
    char side;  ///< against the root
  };
  Place find(std::uint32_t node) {
    std::uint32_t root = node;
    char side = 0;
    while (parent_[root] != root) {
      side ^= side_[root];
      root = parent_[root];
    }
    // Everything on the way hangs on the root from now on.
    char left = side;
    while (parent_[node] != node) {
      const std::uint32_t next = parent_[node];
      const char own = side_[node];
      parent_[node] = root;
      side_[node] = left;
      left ^= own;
      node = next;
    }
    return {root, side};
  }

  void join(std::uint32_t a, std::uint32_t b, char opposite) {
    const Place x = find(a), y = find(b);
    if (x.root == y.root) return;
    parent_[y.root] = x.root;
    side_[y.root] = static_cast<char>(x.side ^ y.side ^ opposite);
  }

 private:
  std::vector<std::uint32_t> parent_;
  std::vector<char> side_;
};

/// The pairs between the same two nodes become one.
void add_up(std::vector<SidePair>& pairs) {
  for (SidePair& pair : pairs) {
    if (pair.first > pair.second) std::swap(pair.first, pair.second);
  }
  std::sort(pairs.begin(), pairs.end(), [](const SidePair& a, const SidePair& b) {
    if (a.first != b.first) return a.first < b.first;
    return a.second != b.second ? a.second < b.second : a.order < b.order;
  });
  std::size_t kept = 0;
  for (const SidePair& pair : pairs) {
    if (kept > 0 && pairs[kept - 1].first == pair.first && pairs[kept - 1].second == pair.second) {
      pairs[kept - 1].weight += pair.weight;
    } else {
      pairs[kept++] = pair;
    }
  }
  pairs.resize(kept);
}

}  // namespace

TwoSides two_sides(std::size_t nodes, std::vector<SidePair> pairs) {
  constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();
  SidedSets sets(nodes);
  std::vector<std::uint32_t> best(nodes, none);
  std::erase_if(pairs, [](const SidePair& pair) { return pair.first == pair.second; });
  while (!pairs.empty()) {
    add_up(pairs);
    const auto before = [&](std::uint32_t a, std::uint32_t b) {
      const double x = std::abs(pairs[a].weight), y = std::abs(pairs[b].weight);
      return x != y ? x > y : pairs[a].order < pairs[b].order;
    };
    for (std::uint32_t i = 0; i < pairs.size(); ++i) {
      for (const std::uint32_t node : {pairs[i].first, pairs[i].second}) {
        if (best[node] == none || before(i, best[node])) best[node] = i;
      }
    }
    for (std::uint32_t i = 0; i < pairs.size(); ++i) {
      const SidePair& pair = pairs[i];
      if (best[pair.first] == i || best[pair.second] == i) sets.join(pair.first, pair.second, pair.weight < 0 ? 1 : 0);
    }
    for (SidePair& pair : pairs) {
      best[pair.first] = best[pair.second] = none;
      const auto first = sets.find(pair.first), second = sets.find(pair.second);
      pair.first = first.root;
      pair.second = second.root;
      if (first.side != second.side) pair.weight = -pair.weight;
    }
    std::erase_if(pairs, [](const SidePair& pair) { return pair.first == pair.second; });
  }
  TwoSides result{std::vector<char>(nodes), std::vector<std::uint32_t>(nodes)};
  for (std::uint32_t node = 0; node < nodes; ++node) {
    const auto place = sets.find(node);
    result.side[node] = place.side;
    result.component[node] = place.root;
  }
  return result;
}

}  // namespace deform::quality
