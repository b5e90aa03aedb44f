// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>

#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/interpolation/saddle_factor.h"

namespace deform {

/// Interpolation by a dense factorization of the system: Cholesky on the complement of the polynomials, or LDL^T of the bordered
/// matrix on request. Where Cholesky breaks down or has no correct digits and the solver is `automatic`, and where LDL^T has
/// none, LDL^T of differences between close centres (DifferenceBasis).
class DenseInterpolator : public Interpolator {
 public:
  DenseInterpolator(std::vector<Vec3> centres, const InterpolationOptions& options, const RunContext& context);

  Solver solver() const override { return solver_; }
  double condition() const override { return factor_->condition(); }
  std::size_t bytes() const override { return factor_->bytes() + centres_.size() * sizeof(Vec3); }

  Interpolants interpolate(const Eigen::MatrixXd& F, double tolerance, const RunContext& context = {}) const override;
  Eigen::MatrixXd adjoint(Eigen::MatrixXd B, const RunContext& context = {}) const override;
  /// The coefficients of interpolate() without refinement, (m + q) x columns, which takes a small part of its time. The
  /// interpolants meet the values to rounding of their terms, though single coefficients may have few correct digits.
  Eigen::MatrixXd unrefined(const Eigen::MatrixXd& F) const;

  /// Solves for right-hand sides B = [f; g], (m + q) x columns, and returns coefficients [w; c] with their uncertainty. The
  /// system is symmetric, so this also solves adjoint problems. Some steps of iterative refinement with accurate residuals
  /// make the result accurate to its last digits as long as condition * eps is well below one, with either solver; otherwise
  /// `converged` is false.
  Interpolants solve_saddle(const Eigen::MatrixXd& B, const RunContext& context = {}) const;

  /// Upper bounds of bytes() and of the peak memory of the construction for m centres.
  static std::size_t bytes_for(std::size_t m, Solver solver);
  static std::size_t peak_bytes(std::size_t m, Solver solver);

 private:
  Solver solver_;
  std::unique_ptr<const SaddleFactor> factor_;
};

}  // namespace deform
