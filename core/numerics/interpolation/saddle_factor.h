// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <span>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/kernels/kernel.h"
#include "core/numerics/kernels/polynomial.h"

namespace deform {

/// A factorization of the bordered RBF system (thesis eq. 3.9, 3.10)
///
///   [ Phi  P ] [w]   [f]      Phi_ij = phi(|x_i - x_j|), m x m
///   [ P^T  0 ] [c] = [g]      P_ij = p_j(x_i), m x q of full rank
///
/// Immutable after construction; any number of threads may solve at once.
class SaddleFactor {
 public:
  virtual ~SaddleFactor() = default;
  /// Replaces B = [f; g], (m + q) x columns, by [w; c].
  virtual void solve(Eigen::MatrixXd& B) const = 0;
  virtual std::size_t bytes() const = 0;
  /// An estimate of the 1-norm condition number of the factored matrix; for Cholesky that is the projected one.
  virtual double condition() const = 0;
};

/// The input of the back-ends. Must outlive the construction of a factor, but not the factor.
struct SaddleProblem {
  RadialKernel kernel;
  std::span<const Vec3> centres;
  const PolynomialSpace& polynomials;
};

/// The back-ends. factor_cholesky() returns nullptr if the matrix is not positive definite to working precision. Throw
/// Error(numerical_failure) if it is singular, cancelled, deadline_exceeded.
std::unique_ptr<SaddleFactor> factor_cholesky(const SaddleProblem& problem, const RunContext& context);
std::unique_ptr<SaddleFactor> factor_ldlt(const SaddleProblem& problem, const RunContext& context);
/// LDL^T of the system for differences between close centres, DifferenceBasis, whose entries are computed in double-double
/// arithmetic and whose rows are of like size: it keeps digits where centres are 1e-4 to 1e-8 of the size of all apart, as those
/// in boundary layers are. condition() is that of this matrix. Takes longer to set up, by about 1e-8 s m^2 of a core.
std::unique_ptr<SaddleFactor> factor_differences(const SaddleProblem& problem, const RunContext& context);

}  // namespace deform
