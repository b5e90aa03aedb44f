// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/interpolation/schwarz.h"

namespace deform {

/// Interpolation of many centres to a tolerance, with memory linear in their number: flexible GMRES (Saad 1993) on the complement
/// of the polynomials with SchwarzPreconditioner and FastSums. The order of the sums is raised until their error, measured
/// against direct sums at sample centres, is below the tolerance. The error of values(), measured at samples of the points, is at
/// most half the tolerance of the interpolants; sums at the centres have an error of at most 1e-13 of the largest.
class IterativeInterpolator : public Interpolator {
 public:
  /// Kernels that are not smooth (Wendland's) have direct sums only, with time quadratic in the number of centres.
  enum class Kernels { smooth, any };
  /// Throws Error(invalid_argument) for kernels that have a parity, and for others than the allowed ones.
  IterativeInterpolator(std::vector<Vec3> centres, const InterpolationOptions& options, const RunContext& context,
                        Kernels allowed = Kernels::smooth);

  Solver solver() const override { return Solver::iterative; }
  std::size_t bytes() const override { return preconditioner_.bytes() + centres_.size() * sizeof(Vec3); }

  Interpolants interpolate(const Eigen::MatrixXd& F, double tolerance, const RunContext& context = {}) const override;
  /// Solves for the residual and returns the better of the old and the new interpolants. Missing the tolerance is not an error.
  Interpolants refine(Interpolants interpolants, const Eigen::MatrixXd& F, double tolerance,
                      const RunContext& context) const override;
  std::vector<double> sums_at_centres(std::span<const Vec3> places, std::span<const double> weights, std::size_t columns,
                                      const RunContext& context) const override;
  /// Accurate to 1e-13 of the largest value, or to rounding.
  Eigen::MatrixXd adjoint(Eigen::MatrixXd B, const RunContext& context = {}) const override;

  /// Solves for right-hand sides B = [f; g], (m + q) x columns: values at the centres, and of the side conditions (0 for
  /// interpolation). All columns use the order of the sums that the most demanding one needs, so digits below the tolerance
  /// depend on which columns are solved together. Reports "solve" progress.
  Interpolants solve_saddle(const Eigen::MatrixXd& B, double tolerance, const RunContext& context) const;

  /// Upper bounds for m centres: of bytes(), and of the peak during a solve with `columns` columns.
  static std::size_t bytes_for(std::size_t m);
  static std::size_t peak_bytes(std::size_t m, std::size_t columns);

  const SchwarzPreconditioner& preconditioner() const { return preconditioner_; }

 private:
  class Solve;

  std::vector<double> weighted_sums(const Interpolants& interpolants, std::span<const double> weights,
                                    std::span<const Vec3> points, double& error, const RunContext& context) const override;

  SchwarzPreconditioner preconditioner_;
};

}  // namespace deform
