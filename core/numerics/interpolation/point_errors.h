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

/// Estimates the error of approximate interpolants at given places. The difference between the exact interpolant and an
/// approximate one is the interpolant of the residual at the centres, so a solution for the residual gives the error, including
/// its amplification between the centres. A part of the centres would not represent it: residuals differ from centre to centre.
///
/// Up to a number of centres it is interpolated with a dense factorization and direct sums, so that nothing is shared with the
/// interpolants that are checked. With more, the residual, by sums that are direct as far as that is affordable, is interpolated
/// iteratively, to a thousandth of its size, and what that leaves is allowed for. Images of centres are centres then, and kernels
/// that are not smooth have direct sums.
/// Immutable; any thread.
class PointErrors {
 public:
  static constexpr std::size_t most_dense = 3000;  ///< largest number of centres for which the system is factored

  /// The places are in the coordinates of the system. Systems of the iterative solver beyond `dense` centres are used again and
  /// must outlive this. Throws Error(numerical_failure), cancelled, deadline_exceeded.
  PointErrors(const Interpolator& system, int polynomial_degree, std::vector<Vec3> places, const RunContext& context,
              std::size_t dense = most_dense);

  const std::vector<Vec3>& places() const { return places_; }
  /// Whether the correction is exact up to rounding.
  bool complete() const { return dense_ != nullptr; }
  /// The correction to interpolants of F (values at all centres of the system, m x columns): the interpolant of their residual at
  /// the centres. The residual is computed in double-double arithmetic if it is near rounding.
  struct Missing {
    Eigen::MatrixXd coefficients;  ///< as Interpolants::coefficients, for the centres and their images
    double residual = 0;           ///< largest at the centres
    bool known = true;             ///< false if the factorization has no digits that would tell
  };
  Missing missing(const Interpolator& system, const Interpolants& interpolants, const Eigen::MatrixXd& F,
                  const RunContext& context) const;
  /// Values of the correction at the places, that is the estimated exact - approximate interpolant: places x columns, in the
  /// units of F.
  Eigen::MatrixXd errors(const Missing& missing, const RunContext& context) const { return errors(missing, places_, context); }
  /// As above at other places.
  Eigen::MatrixXd errors(const Missing& missing, std::span<const Vec3> places, const RunContext& context) const;
  /// The largest absolute value of each column at any of these points and in `errors`, by fast sums where there are many: too
  /// large by 5 % of the largest in `errors` at most, or by the error of sums that do not reach that.
  Eigen::VectorXd largest(const Missing& missing, const Eigen::MatrixXd& errors, std::span<const Vec3> points,
                          const RunContext& context) const;

  std::size_t bytes() const;
  /// Upper bounds for m centres: of bytes(), of the peak memory of the construction and of missing(), and of that of largest()
  /// for n points.
  static std::size_t bytes_for(std::size_t m, const RadialKernel& kernel, Solver solver);
  static std::size_t peak_bytes(std::size_t m, const RadialKernel& kernel, Solver solver);
  static std::size_t largest_bytes(std::size_t n, std::size_t m, const RadialKernel& kernel);

 private:
  /// A centre of the exact system: an image of one of the system's.
  struct Row {
    std::uint32_t centre;
    double sign;
  };

  Eigen::MatrixXd residual(const Interpolator& system, const Interpolants& interpolants, const Eigen::MatrixXd& F, double& error,
                           const RunContext& context) const;

  std::vector<Vec3> places_;
  std::vector<Row> rows_;  ///< empty if the centres are the system's
  std::unique_ptr<const DenseInterpolator> dense_;
  std::unique_ptr<const IterativeInterpolator> own_;
  const IterativeInterpolator* iterative_ = nullptr;  ///< own_ or the system
  const Interpolator* exact_ = nullptr;               ///< dense_ or iterative_
};

}  // namespace deform
