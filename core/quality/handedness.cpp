// SPDX-License-Identifier: Apache-2.0
#include "core/quality/handedness.h"

#include <algorithm>
#include <array>
#include <numeric>

namespace deform::quality {

namespace {

constexpr std::size_t least_block = 10;  // cells

/// Sets of cells that are joined pair by pair.
class Sets {
 public:
  explicit Sets(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), 0u); }

  std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::uint32_t a, std::uint32_t b) { parent_[std::max(find(a), find(b))] = std::min(find(a), find(b)); }

 private:
  std::vector<std::uint32_t> parent_;
};

struct Votes {
  std::size_t cells = 0;
  std::int64_t balance = 0;  ///< positive ones less mirrored ones
};

std::vector<Votes> votes(Sets& sets, std::span<const Orientation> cells) {
  std::vector<Votes> result(cells.size());
  for (std::uint32_t c = 0; c < cells.size(); ++c) {
    Votes& of = result[sets.find(c)];
    ++of.cells;
    of.balance += static_cast<int>(cells[c]);
  }
  return result;
}

}  // namespace

std::vector<char> left_handed_cells(std::span<const Orientation> cells, std::span<const CellLink> links) {
  Sets blocks(cells.size()), connected(cells.size());
  for (const CellLink& link : links) {
    connected.join(link.a, link.b);
    if (link.consistent) blocks.join(link.a, link.b);
  }
  const std::vector<Votes> of_block = votes(blocks, cells), of_all = votes(connected, cells);
  std::vector<char> left(cells.size());
  for (std::uint32_t c = 0; c < cells.size(); ++c) {
    const Votes& block = of_block[blocks.find(c)];
    const Votes& all = of_all[connected.find(c)];
    left[c] = (block.cells < least_block ? all : block).balance < 0;
  }
  if (std::find(left.begin(), left.end(), 1) == left.end()) left.clear();
  return left;
}

void SideLinks::add(std::uint32_t cell, std::span<const std::uint32_t> nodes) {
  if (nodes.size() < 2) return;
  // Places of the smallest nodes.
  std::array<std::size_t, 3> at{};
  const std::size_t kept = std::min<std::size_t>(3, nodes.size());
  for (std::size_t k = 0; k < kept; ++k) {
    const auto taken = [&](std::size_t i) { return std::find(at.begin(), at.begin() + k, i) != at.begin() + k; };
    std::size_t least = 0;
    while (taken(least)) ++least;
    for (std::size_t i = least + 1; i < nodes.size(); ++i) {
      if (nodes[i] < nodes[least] && !taken(i)) least = i;
    }
    at[k] = least;
  }
  Side side{{nodes[at[0]], nodes[at[1]], kept > 2 ? nodes[at[2]] : ~0u}, cell, false};
  if (kept == 2) {
    side.forward = at[0] < at[1];
  } else {
    side.forward = (at[0] < at[1]) + (at[1] < at[2]) + (at[2] < at[0]) == 2;  // an even permutation of their places
  }
  sides_.push_back(side);
}

std::vector<CellLink> SideLinks::links() && {
  const auto same = [](const Side& a, const Side& b) { return std::equal(a.key, a.key + 3, b.key); };
  std::sort(sides_.begin(), sides_.end(), [](const Side& a, const Side& b) {
    const auto order = std::lexicographical_compare_three_way(a.key, a.key + 3, b.key, b.key + 3);
    return order != 0 ? order < 0 : a.cell < b.cell;
  });
  std::vector<CellLink> links;
  for (std::size_t i = 0; i < sides_.size();) {
    std::size_t end = i + 1;
    while (end < sides_.size() && same(sides_[i], sides_[end])) ++end;
    if (end - i == 2) links.push_back({sides_[i].cell, sides_[i + 1].cell, sides_[i].forward != sides_[i + 1].forward});
    i = end;
  }
  return links;
}

std::size_t SideLinks::bytes_for(std::size_t sides) { return 2 * sides * sizeof(Side) + sides * sizeof(CellLink) / 2; }

}  // namespace deform::quality
