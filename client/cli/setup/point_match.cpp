// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/point_match.h"

#include <algorithm>
#include <cmath>

#include "core/base/vectors.h"

namespace deform::cli {

std::size_t PointMatch::Hash::operator()(const Cell& cell) const {
  std::uint64_t hash = 0;
  for (const std::int64_t k : cell) hash = (hash ^ static_cast<std::uint64_t>(k)) * 0x9e3779b97f4a7c15u;
  return static_cast<std::size_t>(hash ^ (hash >> 32));
}

PointMatch::Cell PointMatch::cell_of(const Vec3& place) const {
  constexpr double limit = 9e18;  // far away all cells are one
  Cell cell{};
  for (std::size_t k = 0; k < 3; ++k) {
    cell[k] = static_cast<std::int64_t>(std::clamp(std::floor(place[k] / tolerance_), -limit, limit));
  }
  return cell;
}

PointMatch::PointMatch(std::span<const Vec3> points, std::span<const PointId> ids, double tolerance)
    : points_(points), ids_(ids), tolerance_(tolerance) {
  for (std::size_t i = 0; i < ids.size(); ++i) cells_[cell_of(points[ids[i]])].push_back(i);
}

std::optional<std::size_t> PointMatch::nearest(const Vec3& place, std::span<const char> taken) const {
  std::optional<std::size_t> best;
  double least = tolerance_;
  const Cell middle = cell_of(place);
  for (std::int64_t i = -1; i <= 1; ++i) {
    for (std::int64_t j = -1; j <= 1; ++j) {
      for (std::int64_t k = -1; k <= 1; ++k) {
        const auto found = cells_.find({middle[0] + i, middle[1] + j, middle[2] + k});
        if (found == cells_.end()) continue;
        for (const std::size_t index : found->second) {
          if (taken[index]) continue;
          const double away = distance(points_[ids_[index]], place);
          if (away > least || (away == least && best && *best < index)) continue;
          least = away;
          best = index;
        }
      }
    }
  }
  return best;
}

}  // namespace deform::cli
