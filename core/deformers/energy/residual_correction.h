// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/interpolation/compact_levels.h"
#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/numerics/kernels/tiles.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// Extends the misfit of a space at the handle and fixed points smoothly to all points: the interpolant of the misfit at a
/// well-distributed subset of the handle and fixed points (farthest-point order), its centres. What this leaves at the other ones
/// next to deformable points is added by CompactLevels, unless only the centres are to be met. Immutable; any thread.
class ResidualCorrection {
 public:
  enum class Kind {
    smooth,  ///< triharmonic
    /// Biharmonic, with constants: differences between close points are not extrapolated. Triharmonic interpolants of the small,
    /// irregular steps of exact placement were up to 140 times as large as the steps elsewhere.
    gentle,
  };

  /// Places closer than this nearly coincide, in unit coordinates: smooth interpolants have one centre for them. Their condition
  /// grows with the inverse cube of the least distance between centres, and at 1e-6 their solutions have no digits.
  static constexpr double near = 1e-4;

  /// For each place the share that it has among those that nearly coincide with it, in unit coordinates: 1 over the sum of
  /// Wendland's C2 function with the radius `near` of the distances from all places. Places that coincide have equal ones, which
  /// add up to one.
  static Eigen::VectorXd shares_of(std::span<const Vec3> places, const RunContext& context);

  /// The number of centres for this number of evaluation points: 600 to 2000, more if that is cheap.
  static std::size_t centres_for(std::size_t points);

  /// The centres where all points next to deformable ones are met: positions among the places, in unit coordinates. Smooth
  /// interpolants have one of places that are closer than `near`, such as unwelded points, and points beside a symmetry plane
  /// with their images.
  static std::vector<std::uint32_t> centres_of(std::span<const Vec3> places, std::size_t most, Kind kind);

  /// `places` are all m handle and fixed points, in unit coordinates. It meets those that are `bound` (m, nonzero), or with an
  /// empty mask only the centres.
  ResidualCorrection(std::span<const Vec3> places, std::size_t most_centres, std::span<const char> bound,
                     const RunContext& context);
  /// The same with the given centres among the places, no two of which may coincide.
  ResidualCorrection(std::span<const Vec3> places, std::vector<std::uint32_t> centres, Kind kind, std::span<const char> bound,
                     const RunContext& context);

  std::size_t bytes() const;
  const std::vector<std::uint32_t>& centres() const { return centres_; }

  /// The coefficients of the interpolants, rows x c, from the misfit (m x c, units of displacements).
  Eigen::MatrixXd coefficients(const Eigen::MatrixXd& misfit, const RunContext& context) const;
  /// The same of the smooth interpolants alone: nothing is added for what they leave.
  Eigen::MatrixXd smooth_coefficients(const Eigen::MatrixXd& misfit, const RunContext& context) const;
  std::size_t rows() const { return smooth_rows() + (levels_ ? levels_->rows() : 0); }
  /// The values at places (one row each) of the interpolants of many misfits, which are rows of a sparse matrix (x m): those of
  /// rows[c] in column c. Their coefficients are not refined.
  Eigen::MatrixXd values(const SparseRows& misfits, std::span<const std::int64_t> rows, std::span<const Vec3> places,
                         const RunContext& context) const;
  /// The rounding of the values of interpolants at these places, at most.
  double rounding(const Eigen::MatrixXd& coefficients, std::span<const Vec3> at, const RunContext& context) const;
  /// Adds the values of the interpolants at a tile to out[c][16]. `coefficients` is row-major with row stride `columns`.
  void add_values(const double* tile, const double* coefficients, std::size_t columns, double* out) const;
  /// Applies the transpose of the map from misfits to values at `points` to X (one vector per point): m x 3.
  Eigen::MatrixXd adjoint(std::span<const Vec3> points, std::span<const Vec3> X, const RunContext& context) const;

 private:
  std::size_t smooth_rows() const { return system_.size() + system_.polynomials().terms(); }
  Eigen::MatrixXd left(const Eigen::MatrixXd& misfit, const Eigen::MatrixXd& smooth, const RunContext& context) const;
  Eigen::MatrixXd smooth_adjoint(std::span<const Vec3> points, std::span<const Vec3> X, const RunContext& context) const;

  std::size_t held_;
  std::vector<std::uint32_t> centres_;  ///< positions among the handle and fixed points
  DenseInterpolator system_;
  std::unique_ptr<const CompactLevels> levels_;  ///< null if nothing is left
  TiledPoints used_;                             ///< those of the levels
};

}  // namespace deform
