// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/interpolation/schwarz.h"

namespace deform {

/// The interpolant of many centres to a tolerance, with memory linear in their number: flexible GMRES (Saad 1993) on the
/// complement of the polynomials with SchwarzPreconditioner and FastSums. The order of the sums is raised until what they leave
/// out, measured against direct sums at sample centres, is below the tolerance. Values are those of the interpolants to half
/// their tolerance, measured at samples of the points; sums at the centres are right to 1e-13 of the largest.
class IterativeInterpolator : public Interpolator {
 public:
  /// Not for kernels that are not smooth (Wendland's), and not with a parity: Error(invalid_argument).
  IterativeInterpolator(std::vector<Vec3> centres, const InterpolationOptions& options, const RunContext& context);

  Solver solver() const override { return Solver::iterative; }
  std::size_t bytes() const override { return preconditioner_.bytes() + centres_.size() * sizeof(Vec3); }

  Interpolants interpolate(const Eigen::MatrixXd& F, double tolerance, const RunContext& context = {}) const override;
  /// Solves for what is left. Not reaching the tolerance is a result, the better of the two.
  Interpolants refine(Interpolants interpolants, const Eigen::MatrixXd& F, double tolerance,
                      const RunContext& context) const override;
  std::vector<double> sums_at_centres(std::span<const Vec3> places, std::span<const double> weights, std::size_t columns,
                                      const RunContext& context) const override;
  /// To 1e-13 of the largest value, or as near as rounding lets it come.
  Eigen::MatrixXd adjoint(Eigen::MatrixXd B, const RunContext& context = {}) const override;

  /// Right-hand sides B = [f; g] for both parts, (m + q) x columns: values at the centres, and those of the side conditions (0
  /// for interpolation). The columns share the order of the sums, which follows the most demanding one: other groups of columns
  /// give other digits below the tolerance. Progress "solve".
  Interpolants solve_saddle(const Eigen::MatrixXd& B, double tolerance, const RunContext& context) const;

  /// Upper bounds for m centres: of bytes(), and with what one solve of `columns` columns takes.
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
