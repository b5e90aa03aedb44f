// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>

#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/interpolation/saddle_factor.h"

namespace deform {

/// The interpolant by a dense factorization of its system: Cholesky on the complement of the polynomials, or LDL^T of the
/// bordered matrix (asked for, or where Cholesky breaks down and the options leave the choice).
class DenseInterpolator : public Interpolator {
 public:
  DenseInterpolator(std::vector<Vec3> centres, const InterpolationOptions& options, const RunContext& context);

  Solver solver() const override { return solver_; }
  double condition() const override { return factor_->condition(); }
  std::size_t bytes() const override { return factor_->bytes() + centres_.size() * sizeof(Vec3); }

  Interpolants interpolate(const Eigen::MatrixXd& F, double tolerance, const RunContext& context = {}) const override;
  Eigen::MatrixXd adjoint(Eigen::MatrixXd B, const RunContext& context = {}) const override;

  /// Right-hand sides B = [f; g] for both parts, (m + q) x columns, to coefficients [w; c] with their uncertainty; the system is
  /// symmetric, so this serves adjoints. Refined with accurate residuals, at most twice: the result is right to its last digits
  /// as long as condition * eps is well below one, whichever the solver; where it is not, `converged` is false.
  Interpolants solve_saddle(const Eigen::MatrixXd& B, const RunContext& context = {}) const;

  /// Upper bounds for m centres.
  static std::size_t bytes_for(std::size_t m, Solver solver);
  static std::size_t peak_bytes(std::size_t m, Solver solver);

 private:
  Solver solver_;
  std::unique_ptr<const SaddleFactor> factor_;
};

}  // namespace deform
