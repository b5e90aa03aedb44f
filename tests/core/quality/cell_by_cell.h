// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <span>
#include <variant>
#include <vector>

#include "core/quality/moving_cells.h"
#include "core/quality/safe_amplitude.h"

namespace deform::test {

/// The cells of a set as those who look at them one by one see them: handed as they are at rest.
inline std::unique_ptr<quality::MovingCells> moving(const CellSet& cells, std::span<const Vec3> rest) {
  std::unique_ptr<quality::MovingCells> result;
  if (const auto* elements = std::get_if<const Elements*>(&cells)) result = quality::moving_elements(**elements, rest.size());
  if (const auto* mesh = std::get_if<const Mesh*>(&cells)) result = quality::moving_faces(**mesh);
  if (const auto* all = std::get_if<const PolyhedralCells*>(&cells)) result = quality::moving_polyhedra(**all, rest.size());
  result->take_as_left_handed(left_handed_cells(rest, cells));
  result->list_nodes();
  return result;
}

/// What InversionCheck has to answer, by the roots and states of every single cell.
inline SafeAmplitude cell_by_cell(std::span<const Vec3> rest, std::span<const Vec3> from, std::span<const Vec3> to,
                                  const CellSet& cells) {
  const auto all = moving(cells, rest);
  SafeAmplitude result;
  Extreme first{std::numeric_limits<double>::infinity(), 0};
  Inversions& inverted = result.inverted;
  for (std::size_t c = 0; c < all->size(); ++c) {
    if (all->state(rest, c).inverted) continue;
    const auto state = all->state(to, c);
    if (state.inverted) inverted.worst.push_back({state.determinant, c});
    inverted.without_volume += state.without_volume;
    inverted.wrong_pyramid += state.wrong_pyramid;
    if (state.determinant < inverted.least_determinant.value) inverted.least_determinant = {state.determinant, c};
    const double s = all->first_inversion(from, to, c, std::min(1.0, first.value));
    if (s < first.value) first = {s, c};
  }
  inverted.count = inverted.worst.size();
  std::stable_sort(inverted.worst.begin(), inverted.worst.end(),
                   [](const Extreme& a, const Extreme& b) { return a.value < b.value; });
  if (inverted.worst.size() > 100) inverted.worst.resize(100);
  if (first.value > 1 && inverted.count > 0) first = {1, inverted.worst.front().id};
  if (first.value > 1) return result;
  result.amplitude = std::min(first.value, std::nextafter(1.0, 0.0));
  result.first_cell = first.id;
  return result;
}

/// Every bit of two answers.
inline void expect_same(const SafeAmplitude& found, const SafeAmplitude& expected) {
  EXPECT_EQ(found.amplitude, expected.amplitude);
  EXPECT_EQ(found.first_cell, expected.first_cell);
  EXPECT_EQ(found.inverted.count, expected.inverted.count);
  EXPECT_EQ(found.inverted.without_volume, expected.inverted.without_volume);
  EXPECT_EQ(found.inverted.wrong_pyramid, expected.inverted.wrong_pyramid);
  EXPECT_EQ(found.inverted.least_determinant.value, expected.inverted.least_determinant.value);
  EXPECT_EQ(found.inverted.least_determinant.id, expected.inverted.least_determinant.id);
  ASSERT_EQ(found.inverted.worst.size(), expected.inverted.worst.size());
  for (std::size_t i = 0; i < found.inverted.worst.size(); ++i) {
    EXPECT_EQ(found.inverted.worst[i].value, expected.inverted.worst[i].value);
    EXPECT_EQ(found.inverted.worst[i].id, expected.inverted.worst[i].id);
  }
}

}  // namespace deform::test
