// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Search for the points within a fixed radius, where most places have none: a grid of cells as wide as the radius, each of which
/// lists the points in it and in its neighbours, so that a search looks at one cell: 27 numbers for each point. Immutable;
/// any thread.
class NearCells {
 public:
  NearCells() = default;
  /// The radius is positive and at least 1e-15 times the extent of the points.
  NearCells(std::span<const Vec3> points, double radius);

  std::size_t size() const { return points_.size(); }
  double radius() const { return radius_; }
  const std::vector<Vec3>& points() const { return points_; }
  std::size_t bytes() const;

  /// Calls use(point, squared distance) for the points nearer to x than the radius, ascending. None for places that are not
  /// finite.
  template <typename Use>
  void for_each(const Vec3& x, const Use& use) const {
    for (const std::uint32_t j : near(x)) {
      const Vec3& p = points_[j];
      const double dx = x[0] - p[0], dy = x[1] - p[1], dz = x[2] - p[2];
      const double square = dx * dx + dy * dy + dz * dz;
      if (square < radius_ * radius_) use(j, square);
    }
  }

 private:
  using Key = std::array<std::int64_t, 3>;
  struct Cell {
    Key key{};
    std::size_t begin = 0;  ///< of its list in near_
    std::size_t count = 0;  ///< 0: an unused place of the table
  };
  Key cell_of(const Vec3& x) const;
  /// The points of the cell in which x lies and of its neighbours.
  std::span<const std::uint32_t> near(const Vec3& x) const;
  /// Where a cell is in the table, or the unused place where it would be.
  std::size_t place_of(const Key& key) const;
  void widen_table();

  std::vector<Vec3> points_;
  double radius_ = 0;
  Vec3 low_{}, high_{};      ///< the box of the points, enlarged by the radius
  std::vector<Cell> table_;  ///< open addressing; its size is a power of two
  std::vector<std::uint32_t> near_;
};

}  // namespace deform
