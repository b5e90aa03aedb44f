// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/numerics/lattice/lattice.h"

namespace deform {

struct CubicAxis;

/// Sums over the functions of a lattice at many places. With cubic splines along all axes the weights are polynomials of the
/// place within its span; points of one cell of the lattice, of which neighbours in a list mostly are, are summed side by side in
/// vector instructions, and of others control points that are neighbours along the first axis. The polynomials are Taylor
/// expansions at the knots (de Boor, A Practical Guide to Splines, 1978). Those of other lattices are summed along one axis after
/// the other. A sum depends on its place and vector alone, bit for bit. Immutable; any thread.
class LatticeSums {
 public:
  static constexpr std::size_t block = 16;  ///< points that are taken together

  explicit LatticeSums(const Lattice& lattice);

  const Lattice& lattice() const { return lattice_; }

  /// out[i * vectors.size() + d] = sum_p vectors[d][p] phi_p(u[i]), where vectors[d] has one vector per control point; 0 where
  /// u[i][0] is negative: outside.
  void operator()(std::span<const Vec3> u, std::span<const Vec3* const> vectors, Vec3* out) const;
  /// The same at u[rows[i]].
  void operator()(std::span<const Vec3> u, std::span<const PointId> rows, std::span<const Vec3* const> vectors, Vec3* out) const;
  /// The same of at most `block` rows: out[(3 d + c) * block + i] is component c of vector d at u[rows[i]].
  void tile(std::span<const Vec3> u, std::span<const PointId> rows, std::span<const Vec3* const> vectors, double* out) const;

 private:
  /// Strides of the output, in doubles.
  struct Strides {
    std::size_t point, vector, component;
  };
  template <typename At>
  void by_blocks(std::size_t count, const At& at, std::span<const Vec3* const> vectors, const Strides& strides,
                 double* out) const;
  std::array<CubicAxis, 3> cubic_axes() const;
  void one_by_one(const Vec3& u, std::span<const Vec3* const> vectors, Vec3* out) const;

  Lattice lattice_;
  /// Per axis and span the coefficients of its four cubic functions, constants first, then those of t, t^2 and t^3 with t in
  /// [0, 1]; empty unless all axes are cubic.
  std::array<std::vector<double>, 3> polynomials_;
};

}  // namespace deform
