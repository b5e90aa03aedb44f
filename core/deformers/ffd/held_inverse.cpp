// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/ffd/held_inverse.h"

namespace deform {

std::vector<std::int64_t> reached_functions(const FunctionRows& rows, const std::vector<PointId>& held) {
  std::vector<bool> any(static_cast<std::size_t>(rows.cols()), false);
  for (const PointId id : held) {
    rows.for_each(id, [&](std::int64_t column, double) { any[static_cast<std::size_t>(column)] = true; });
  }
  std::vector<std::int64_t> result;
  for (std::size_t j = 0; j < any.size(); ++j) {
    if (any[j]) result.push_back(static_cast<std::int64_t>(j));
  }
  return result;
}

std::map<std::int64_t, std::vector<std::int64_t>> points_by_function(const FunctionRows& rows, const std::vector<PointId>& held) {
  std::map<std::int64_t, std::vector<std::int64_t>> result;
  for (std::size_t j = 0; j < held.size(); ++j) {
    if (rows.count(held[j]) == 0) continue;
    std::int64_t first = -1;
    rows.for_each(held[j], [&](std::int64_t column, double) { first = first < 0 ? column : first; });
    result[first].push_back(static_cast<std::int64_t>(j));
  }
  return result;
}

}  // namespace deform
