// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/quality/two_sides.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace deform::quality::two_sides_test {
namespace {

TEST(TwoSides, ContradictsNothingThatAgrees) {
  std::mt19937_64 random(1);
  for (int k = 0; k < 20; ++k) {
    constexpr std::uint32_t nodes = 200, parts = 3;  // node i belongs to part i % 3
    std::vector<char> truth(nodes);
    for (char& side : truth) side = static_cast<char>(random() % 2);
    std::vector<SidePair> pairs;
    for (std::uint32_t i = 0; i + parts < nodes; ++i) pairs.push_back({i, i + parts, 0, 0});
    for (int extra = 0; extra < 400; ++extra) {
      const auto a = static_cast<std::uint32_t>(random() % nodes), b = static_cast<std::uint32_t>(random() % nodes);
      if (a % parts == b % parts) pairs.push_back({a, b, 0, 0});
    }
    for (std::uint32_t i = 0; i < pairs.size(); ++i) {
      pairs[i].order = i;
      pairs[i].weight = (1 + static_cast<double>(random() % 9)) * (truth[pairs[i].first] == truth[pairs[i].second] ? 1 : -1);
    }
    const TwoSides found = two_sides(nodes, pairs);
    for (std::uint32_t i = 0; i < nodes; ++i) {
      for (std::uint32_t j = 0; j < i; ++j) {
        ASSERT_EQ(found.component[i] == found.component[j], i % parts == j % parts);
        if (i % parts != j % parts) continue;
        ASSERT_EQ(found.side[i] == found.side[j], truth[i] == truth[j]);
      }
    }
  }
}

TEST(TwoSides, ManyOutvoteFewInAnyOrder) {
  // Two chains of ten, opposite to each other rung by rung; a pair says they are on one side.
  std::vector<SidePair> pairs;
  const auto add = [&](std::uint32_t a, std::uint32_t b, double weight) {
    pairs.push_back({a, b, static_cast<std::uint32_t>(pairs.size()), weight});
  };
  for (std::uint32_t i = 0; i + 1 < 10; ++i) {
    add(i, i + 1, 1);
    add(10 + i, 11 + i, 1);
  }
  for (std::uint32_t i = 0; i < 10; ++i) add(i, 10 + i, -0.5);
  add(0, 19, 0.9);
  std::mt19937_64 random(2);
  for (int k = 0; k < 20; ++k) {
    const TwoSides found = two_sides(20, pairs);
    for (std::uint32_t i = 0; i < 20; ++i) EXPECT_EQ(found.side[i] == found.side[0], i < 10) << i;
    std::shuffle(pairs.begin(), pairs.end(), random);
  }
}

TEST(TwoSides, NodesWithoutPairsAreAlone) {
  const TwoSides found = two_sides(3, {{1, 1, 0, -1}});
  EXPECT_NE(found.component[0], found.component[1]);
  EXPECT_NE(found.component[1], found.component[2]);
  EXPECT_TRUE(two_sides(0, {}).side.empty());
}

}  // namespace
}  // namespace deform::quality::two_sides_test
