// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/numerics/lattice/lattice.h"

namespace deform {

/// An axis of a lattice with more control points, which makes the same shapes and others (thesis 4.5): every spline of the
/// coarser axis is a sum of those of the finer one, sum_j c_j N_j = sum_i (sum_j r_ij c_j) M_i. The cubic bases by insertion of a
/// knot into the middle of every span (blossoms, L. Ramshaw 1989; the same as W. Boehm 1980, one knot after the other), from n
/// control points to 2 n - 3; Bernstein polynomials by degree elevation, from n to n + 1. The weights r_ij are not negative and
/// add up to 1.
class AxisRefinement {
 public:
  /// basis: that of `coarse`. Throws Error(invalid_argument) for a Bernstein axis of the highest degree there is.
  AxisRefinement(LatticeBasis basis, const SplineAxis& coarse);

  const SplineAxis& fine() const { return fine_; }
  /// The weights of control point i of the finer axis: of those of the coarser axis from `first` on.
  struct Row {
    std::size_t first = 0;
    std::vector<double> weights;
  };
  const Row& row(std::size_t i) const { return rows_[i]; }
  /// The control points of the coarser axis that one of the finer axis stands for: the one to which it is the nearest at rest,
  /// else the two that it lies between. Each of the coarser axis has one that stands for it alone.
  const std::vector<std::size_t>& parents(std::size_t i) const { return parents_[i]; }

 private:
  void find_parents(const SplineAxis& coarse);

  SplineAxis fine_;
  std::vector<Row> rows_;
  std::vector<std::vector<std::size_t>> parents_;
};

/// A lattice with the same frame and more control points along some of its axes.
class LatticeRefinement {
 public:
  /// axes: which are refined. Throws what AxisRefinement throws.
  LatticeRefinement(const Lattice& coarse, LatticeBasis basis, const std::array<bool, 3>& axes);

  const Lattice& fine() const { return fine_; }
  /// Values at the control points of the finer lattice that give the same sum everywhere; one per control point of the coarser.
  std::vector<Vec3> refined(std::span<const Vec3> values) const;
  /// The control points of the finer lattice all of whose parents are selected; ids ascending, and so is the result. Selections
  /// without common control points stay so, none becomes empty.
  std::vector<std::size_t> refined_selection(std::span<const std::size_t> ids) const;

 private:
  std::array<std::size_t, 3> sizes_{};               ///< of the coarser lattice
  std::array<std::vector<AxisRefinement>, 3> axes_;  ///< one, or none where the axis stays as it is
  Lattice fine_;
};

}  // namespace deform
