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
#include "core/numerics/interpolation/iterative_interpolator.h"

namespace deform {

/// Selects the points at which to check an approximate interpolant: points next to centres, points farthest from them (where
/// errors at the centres are amplified most), and a sample of all. Returns at most `most` indices, ascending. Deterministic.
std::vector<std::uint32_t> check_points(std::span<const Vec3> points, std::span<const Vec3> centres, std::size_t most = 384);

/// The largest absolute value of an entry; infinity if any entry is NaN.
double largest_magnitude(const Eigen::MatrixXd& errors);

/// Largest numbers of centres of which PointErrors use all.
struct PointErrorLimits {
  std::size_t dense = 3000, iterative = 20000;
};

/// Estimates the error of approximate interpolants at given places. The difference between the exact interpolant and an
/// approximate one is the interpolant of the residual at the centres, so an exact solution for the residual gives the error,
/// including its amplification between the centres.
///
/// Up to Limits::dense centres all of them are used, with a dense factorization and direct sums, so that nothing is shared with
/// the interpolants that are checked. Beyond that,
///  - where the residual changes from centre to centre (incremental QR) or the error is local (kernels with a shape), a part of
///    the centres does not represent it: up to Limits::iterative centres the residual, by direct sums at all of them, is
///    interpolated iteratively, to a thousandth of its size, and what that leaves is allowed for;
///  - else, and for kernels and parities that the iterative solver does not take, the centres around every place are used, fewer
///    with increasing distance, and a sample of all.
/// Immutable; any thread.
class PointErrors {
 public:
  static constexpr std::size_t most_centres = PointErrorLimits().dense;
  using Limits = PointErrorLimits;

  /// The places are in the coordinates of the system. Throws Error(numerical_failure), cancelled, deadline_exceeded.
  PointErrors(const Interpolator& system, int polynomial_degree, std::vector<Vec3> places, const RunContext& context,
              const Limits& limits = {});

  const std::vector<Vec3>& places() const { return places_; }
  /// Whether all centres of the system are used and the error is exact up to rounding.
  bool complete() const { return ids_.size() == centres_ && !iterative_; }
  /// Whether a part of the centres of the system is used.
  bool partial() const { return ids_.size() < centres_; }
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
  static std::size_t bytes_for(std::size_t m, const RadialKernel& kernel, Solver solver);
  static std::size_t peak_bytes(std::size_t m, const RadialKernel& kernel, Solver solver);

 private:
  Eigen::MatrixXd residual(const Interpolator& system, const Interpolants& interpolants, const Eigen::MatrixXd& F,
                           const RunContext& context) const;

  std::vector<Vec3> places_;
  std::vector<std::uint32_t> ids_;  ///< centres in use
  std::size_t centres_ = 0;         ///< of the system
  std::unique_ptr<const DenseInterpolator> dense_;
  std::unique_ptr<const IterativeInterpolator> iterative_;
  const Interpolator* exact_ = nullptr;  ///< one of these
};

}  // namespace deform
