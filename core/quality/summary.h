// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <vector>

namespace deform::quality {

/// The largest number of ids in a list of the worst.
constexpr std::size_t most_listed = 100;

/// The ids from 0 to count - 1 with the smallest value(id), in ascending order, equal ones by id; at most most_listed. NaN counts
/// as smallest.
template <typename Value>
std::vector<std::size_t> worst_of(std::size_t count, const Value& value) {
  std::vector<std::size_t> ids(count);
  std::iota(ids.begin(), ids.end(), std::size_t{0});
  const auto key = [&](std::size_t id) {
    const double v = value(id);
    return std::isnan(v) ? -std::numeric_limits<double>::infinity() : v;
  };
  const auto listed = static_cast<std::ptrdiff_t>(std::min(count, most_listed));
  std::partial_sort(ids.begin(), ids.begin() + listed, ids.end(), [&](std::size_t a, std::size_t b) {
    const double x = key(a), y = key(b);
    return x != y ? x < y : a < b;
  });
  ids.resize(static_cast<std::size_t>(listed));
  return ids;
}

/// The index of a value in `bins` equal parts of low..high. Values outside belong to the first or last bin, NaN to the first.
inline std::size_t bin_of(double value, double low, double high, std::size_t bins) {
  const double place = (value - low) / (high - low) * static_cast<double>(bins);
  if (!(place > 0)) return 0;
  return place >= static_cast<double>(bins) ? bins - 1 : static_cast<std::size_t>(place);
}

}  // namespace deform::quality
