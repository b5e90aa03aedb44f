// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/sampling/near_cells.h"
#include "core/numerics/sparse/sparse_cholesky.h"

namespace deform {

/// The places of a CompactLevels, to choose its levels from.
struct LevelPlaces {
  std::span<const Vec3> places;
  std::span<const std::uint32_t> known;  ///< where the values are zero already
  std::span<const char> bound;           ///< of each place: whether it is to be met
};

/// One level: the functions of its places have one radius.
struct CompactLevel {
  double radius = 0;
  std::vector<std::uint32_t> members;  ///< ascending
};

/// Chooses levels so that all bound places belong to one, but for those that coincide (within 1e-12) with others. The spacing is
/// about half of that of the level before, at first of that of the known places, and the radius four times the spacing. Each
/// level has the places of those before it, so that what is met stays met; but of many not those whose functions no new one
/// overlaps, directly or by way of others, and of the places that are not bound only those within the radius of a bound one.
/// Deterministic.
std::vector<CompactLevel> choose_levels(const LevelPlaces& from, const RunContext& context);

/// The lower triangle of the matrix of a level, whose cells are those of its members.
SparseMatrix level_matrix(const NearCells& cells);

/// Interpolates values at many places that are zero at some of them and vary little between these: sums of Wendland's C2
/// functions with a radius that gets smaller from level to level, each level interpolating what those before leave (Floater, Iske
/// 1996; Wendland, Scattered Data Approximation, 17.2). Their matrices are sparse and well-conditioned, whatever the distances of
/// the places. Values are zero farther from the places than the radius of the first level. Next to a flat set of places the
/// functions do not change in the direction of its normal, to first order, so that layers of thin cells keep their thickness.
/// Immutable; any thread.
class CompactLevels {
 public:
  CompactLevels(std::span<const Vec3> places, std::vector<CompactLevel> levels, const RunContext& context);

  /// The places that belong to a level, ascending: positions among the places. The values at the others do not matter.
  const std::vector<std::uint32_t>& used() const { return used_; }
  std::span<const Vec3> used_places() const { return used_places_; }
  /// The number of coefficients.
  std::size_t rows() const { return rows_; }
  std::size_t bytes() const;
  /// What it will take, from the symbolic analysis of its matrices: bytes() with another copy of used_places(), at least, and the
  /// peak while it is made.
  struct Bytes {
    std::size_t resident = 0, peak = 0;
  };
  static Bytes estimate(std::span<const Vec3> places, std::span<const CompactLevel> levels);

  /// The coefficients, rows x c, of the interpolants of values at used() (one row each). Each column does not depend on the
  /// others, bit for bit.
  Eigen::MatrixXd coefficients(const Eigen::MatrixXd& values, const RunContext& context) const;
  /// Adds the values of the interpolants at a tile of points to out[c][16]. `coefficients` is row-major with row stride
  /// `columns`.
  void add_values(const double* tile, const double* coefficients, std::size_t columns, double* out) const;
  /// The largest rounding error of a value at these places: of the sum of the magnitudes of its terms.
  double rounding(const double* coefficients, std::size_t stride, std::span<const Vec3> at) const;
  /// Applies the transpose of the map from values at used() to values at `points` to X (one vector per point): u x 3.
  Eigen::MatrixXd adjoint(std::span<const Vec3> points, std::span<const Vec3> X, const RunContext& context) const;

 private:
  struct Level {
    NearCells cells;
    std::vector<std::uint32_t> members;  ///< positions in used()
    std::size_t first = 0;               ///< of its coefficients
    SparseCholesky factor;
  };

  std::vector<Level> levels_;
  std::vector<std::uint32_t> used_;
  std::vector<Vec3> used_places_;
  std::vector<std::uint32_t> last_level_;  ///< of each of used(): the last one to which it belongs
  std::size_t rows_ = 0;
};

}  // namespace deform
