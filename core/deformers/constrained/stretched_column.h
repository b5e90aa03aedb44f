// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// A column of cells on a wall, as the solver sees it: stretched so that an error of a height counts as much as one of the same
/// fraction of the width.
///
/// The shape that fits the points themselves best hardly knows the heights of thin layers: an error of all of a height of 1e-5
/// is one of 1e-5 beside errors of 1e-3 across the column, which the fit trades for it. So the points x of the column are
/// replaced by as many others y = A x, weighted sums of them:
///   y = x for the corners of the wall and for nodes that are no corners (mid-edge, mid-face), and
///   y = x_0 + s e for a corner of a layer,
/// where x_0 is the corner of the wall below, e the edge of the layer that leads up to x, and s = width / height of the layer at
/// rest, at least 1, with the square root of the area of the wall face as width. So each layer stands on the wall by itself, as
/// high as it is wide.
///
/// A is invertible, takes translations to themselves and commutes with rotations: the points are a rigid copy of those at rest
/// if and only if the stretched ones are. Its rows sum to 1. Immutable; any thread.
class StretchedColumn {
 public:
  static constexpr std::size_t point_bytes = 2 * (sizeof(Vec3) + sizeof(std::uint32_t));  ///< memory for a point, about

  /// The places of corners among the points of the set: those around the wall face, then those above them, level by level.
  struct Corners {
    std::size_t sides = 0;
    std::vector<std::uint32_t> places;
  };

  /// `rest` holds all points of the column (n), which move along the plane with the unit normal `flat` only; null: in space.
  StretchedColumn(Corners corners, std::span<const Vec3> rest, const Vec3* flat = nullptr);

  std::size_t layers() const { return scales_.size(); }
  std::size_t sides() const { return corners_.sides; }
  /// The place of a corner among the points of the set; level 0 is the wall.
  std::uint32_t corner(std::size_t level, std::size_t c) const { return corners_.places[level * corners_.sides + c]; }
  const std::vector<Vec3>& rest() const { return rest_; }        ///< A times the points at rest, n
  const Projection& projection() const { return *projection_; }  ///< onto the rigid copies of rest()
  std::vector<Vec3> stretched(std::span<const Vec3> x) const;    ///< A x
  std::vector<Vec3> unstretched(std::span<const Vec3> y) const;  ///< A^-1 y
  std::vector<Vec3> adjoint(std::span<const Vec3> y) const;      ///< A^T y

  /// An entry of a row of A: the place of a point of the set, and its factor.
  using Entry = std::pair<std::uint32_t, double>;

  /// Calls use(row, entries) for every row of A, the rows in some order; entries of one place add up.
  template <typename Use>
  void for_each_row(const Use& use) const {
    std::vector<Entry> entries;
    for (const std::uint32_t place : plain_) {
      entries.assign(1, {place, 1.0});
      use(place, std::span<const Entry>(entries));
    }
    for (std::size_t layer = 0; layer < layers(); ++layer) {
      for (std::size_t c = 0; c < corners_.sides; ++c) {
        entries = {{corner(0, c), 1.0}, {corner(layer + 1, c), scales_[layer]}, {corner(layer, c), -scales_[layer]}};
        use(corner(layer + 1, c), std::span<const Entry>(entries));
      }
    }
  }

  /// The height of each layer at points x of the column over that at rest, 1 for layers without one. A height is the mean of the
  /// edges of a layer along the normal of the faces below and above it. Negative for a layer that is turned over.
  std::vector<double> relative_heights(std::span<const Vec3> x) const;

 private:
  std::vector<double> heights(std::span<const Vec3> x) const;
  Vec3 mean_edge(std::span<const Vec3> x, std::size_t layer) const;
  Vec3 area(std::span<const Vec3> x, std::size_t level) const;

  Corners corners_;
  std::vector<std::uint32_t> plain_;  ///< places of the other points and of the corners of the wall
  std::vector<double> rest_heights_;  ///< their sign is that of the order around the face
  std::vector<double> scales_;        ///< s of each layer
  std::vector<Vec3> rest_;
  std::shared_ptr<const Projection> projection_;
};

}  // namespace deform
