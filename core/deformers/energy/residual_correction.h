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
#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

/// What a space leaves of the prescribed displacements, carried along smoothly: the interpolant of the misfit at a well-spread
/// part of the held points (farthest-point order). Immutable; any thread.
class ResidualCorrection {
 public:
  enum class Kind {
    smooth,  ///< triharmonic
    /// Biharmonic, with constants: what differs between points close to each other is not carried on beyond them. Triharmonic
    /// interpolants of the small, uneven steps of exact placement were 140 times as large as the steps elsewhere.
    gentle,
  };

  /// How many centres may be evaluated at that many points: 600 to 2000, more where that is cheap.
  static std::size_t centres_for(std::size_t points);

  /// places: of all m held points, unit coordinates.
  ResidualCorrection(std::span<const Vec3> places, std::size_t most_centres, const RunContext& context);
  /// At these of them, no two in one place.
  ResidualCorrection(std::span<const Vec3> places, std::vector<std::uint32_t> centres, Kind kind, const RunContext& context);

  std::size_t bytes() const { return system_.bytes(); }
  const std::vector<std::uint32_t>& centres() const { return centres_; }

  /// Coefficients of the interpolants from the misfit (m x c, displacement units): rows x c.
  Eigen::MatrixXd coefficients(const Eigen::MatrixXd& misfit, const RunContext& context) const;
  std::size_t rows() const { return system_.size() + system_.polynomials().terms(); }
  /// out[c][16] += their values at a tile; coefficients row by row with stride `columns`.
  void add_values(const double* tile, const double* coefficients, std::size_t columns, double* out) const;
  /// m x 3: transpose of "misfit to values at `points`" applied to X (one vector per point).
  Eigen::MatrixXd adjoint(std::span<const Vec3> points, std::span<const Vec3> X, const RunContext& context) const;

 private:
  std::size_t held_;
  std::vector<std::uint32_t> centres_;  ///< among the held points
  DenseInterpolator system_;
};

}  // namespace deform
