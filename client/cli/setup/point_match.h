// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "core/base/types.h"

namespace deform::cli {

/// Finds points by their place. Immutable.
class PointMatch {
 public:
  /// Matches those of `points` that have these ids; tolerance > 0, model units. Views both.
  PointMatch(std::span<const Vec3> points, std::span<const PointId> ids, double tolerance);

  /// Index into ids of the nearest point at most `tolerance` away that is not taken (one entry per id); of several equally near
  /// the first.
  std::optional<std::size_t> nearest(const Vec3& place, std::span<const char> taken) const;

 private:
  using Cell = std::array<std::int64_t, 3>;
  struct Hash {
    std::size_t operator()(const Cell& cell) const;
  };
  Cell cell_of(const Vec3& place) const;

  const std::span<const Vec3> points_;
  const std::span<const PointId> ids_;
  const double tolerance_;
  std::unordered_map<Cell, std::vector<std::size_t>, Hash> cells_;  ///< of edge length tolerance
};

}  // namespace deform::cli
