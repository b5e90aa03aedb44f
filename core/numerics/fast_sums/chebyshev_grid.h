// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Polynomial interpolation in a box at a tensor grid of `order` Chebyshev points per axis (Fong, Darve: The black-box fast
/// multipole method, 2009). Node (i, j, k) has the number (i * order + j) * order + k. Immutable; any thread.
class ChebyshevGrid {
 public:
  explicit ChebyshevGrid(int order);

  std::size_t order() const { return order_; }
  std::size_t nodes() const { return order_ * order_ * order_; }
  /// The nodes of a box.
  std::vector<Vec3> nodes(const Vec3& centre, double half) const;

  /// Values of the `order` one-dimensional interpolation polynomials at x in [-1, 1].
  void values(double x, double* out) const;
  /// Values of the polynomials of all nodes at the 16 points of a tile, as out[node][16]. The coordinates of the tile are global,
  /// not relative to the box.
  void tile_values(const double* tile, const Vec3& centre, double half, double* out) const;

  /// to_parent() adds the transposed interpolation of the values at the nodes of child `octant` (bits: x 4, y 2, z 1) to
  /// those of its parent; to_child() adds the interpolation of the parent's values to those of the child. Both are nodes x
  /// columns, row-major.
  void to_parent(unsigned octant, const double* child, std::size_t columns, double* parent) const;
  void to_child(unsigned octant, const double* parent, std::size_t columns, double* child) const;

  /// The permutation of the nodes under symmetry s of the cube, 0..47. Symmetry s = 8 * p + f permutes the axes by axis_order(p),
  /// then flips those whose bit is set in f (x 4, y 2, z 1).
  const std::vector<std::uint16_t>& symmetry(std::size_t s) const { return symmetries_[s]; }
  static const std::array<std::uint8_t, 3>& axis_order(std::size_t p);

 private:
  void along_axes(unsigned octant, bool up, const double* from, std::size_t columns, double* to) const;

  std::size_t order_;
  std::vector<double> roots_;
  std::vector<double> chebyshev_;                // order x order: T_k at the roots
  std::array<std::vector<double>, 2> transfer_;  // order x order: parent's polynomial i at node j of the lower, upper half
  std::array<std::vector<std::uint16_t>, 48> symmetries_;
};

}  // namespace deform
