#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

namespace deform::quality {

/// How many ids a list of the worst has.
constexpr std::size_t most_listed = 100;

/// Ids from 0 to count - 1 with the least value(id), least first, equal ones by id, at most most_listed.
template <typename Value>
std::vector<std::size_t> worst_of(std::size_t count, const Value& value) {
  std::vector<std::size_t> ids(count);
  std::iota(ids.begin(), ids.end(), std::size_t{0});
  const auto listed = static_cast<std::ptrdiff_t>(std::min(count, most_listed));
  std::partial_sort(ids.begin(), ids.begin() + listed, ids.end(), [&](std::size_t a, std::size_t b) {
    const double x = value(a), y = value(b);
    return x != y ? x < y : a < b;
  });
  ids.resize(static_cast<std::size_t>(listed));
  return ids;
}

}  // namespace deform::quality
