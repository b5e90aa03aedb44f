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

namespace deform {

/// Selects the points at which to check an approximate interpolant: points next to centres, points farthest from them (where
/// errors at the centres are amplified most), and a sample of all. Returns at most `most` indices, ascending. Deterministic.
std::vector<std::uint32_t> check_points(std::span<const Vec3> points, std::span<const Vec3> centres, std::size_t most = 384);

/// The largest absolute value of an entry; infinity if any entry is NaN.
double largest_magnitude(const Eigen::MatrixXd& errors);

/// Estimates the error of approximate interpolants at given places. The difference between the exact interpolant and an
/// approximate one is the interpolant of the residual at the centres, so an exact solution for the residual gives the error,
/// including its amplification between the centres. Up to most_centres centres all of them are used; beyond that those around
/// every place, fewer with increasing distance, and a sample of all. Uses a dense factorization and direct sums, so it shares
/// neither the solver nor the sums with the interpolants it checks. Immutable; any thread.
class PointErrors {
 public:
  static constexpr std::size_t most_centres = 3000;

  /// The places are in the coordinates of the system. Throws Error(numerical_failure), cancelled, deadline_exceeded.
  PointErrors(const Interpolator& system, int polynomial_degree, std::vector<Vec3> places, const RunContext& context);

  const std::vector<Vec3>& places() const { return places_; }
  /// Whether all centres of the system are used, so that the error is exact up to rounding.
  bool complete() const { return complete_; }
  /// The correction to interpolants of F (values at all centres of the system, m x columns): the interpolant of their residual at
  /// the centres in use. The residual is computed in double-double arithmetic if it is near rounding. If it is larger at the
  /// other centres, the correction is scaled up accordingly.
  struct Missing {
    Eigen::MatrixXd coefficients;  ///< as Interpolants::coefficients, for the centres in use
    double residual = 0;           ///< largest at these centres
  };
  Missing missing(const Interpolator& system, const Interpolants& interpolants, const Eigen::MatrixXd& F,
                  const RunContext& context) const;
  /// Values of the correction at the places, that is the estimated exact - approximate interpolant: places x columns, in the
  /// units of F.
  Eigen::MatrixXd errors(const Missing& missing, const RunContext& context) const { return errors(missing, places_, context); }
  /// As above at other places.
  Eigen::MatrixXd errors(const Missing& missing, std::span<const Vec3> places, const RunContext& context) const;

  std::size_t bytes() const;
  /// Upper bounds for m centres: of bytes(), and of the peak memory of the construction.
  static std::size_t bytes_for(std::size_t m);
  static std::size_t peak_bytes(std::size_t m);

 private:
  Eigen::MatrixXd residual(const Interpolator& system, const Interpolants& interpolants, const Eigen::MatrixXd& F,
                           const RunContext& context) const;

  std::vector<Vec3> places_;
  std::vector<std::uint32_t> ids_;  ///< centres in use
  bool complete_ = false;
  std::unique_ptr<const DenseInterpolator> exact_;
};

}  // namespace deform
