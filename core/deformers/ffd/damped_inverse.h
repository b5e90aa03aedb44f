// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/ffd/held_inverse.h"
#include "core/numerics/sparse/sparse.h"
#include "core/numerics/sparse/sparse_cholesky.h"

namespace deform {

/// Direct manipulation by lattices that are too large for a singular value decomposition: with the m x k matrix Phi of the
/// functions at the held points, coefficients minimize |Phi w - h|^2 + (damping s)^2 |w|^2, where s is the largest singular
/// value. Singular values s_i count with s_i^2 / (s_i^2 + (damping s)^2) instead of being truncated (Tikhonov; Hansen,
/// Rank-Deficient and Discrete Ill-Posed Problems, 5.1). The equations are sparse and factored once; iterative refinement
/// makes up for what their condition costs.
class DampedInverse : public HeldInverse {
 public:
  /// Limits of the damping. With less the equations lose all digits.
  static constexpr double least_damping = 1e-6, largest_damping = 0.5;
  /// The largest number of functions that are nonzero at held points. An estimate of the cost takes their sparse matrix.
  static constexpr std::size_t most_functions = 30000;

  /// The clamp is the damping. The automatic one is chosen among 1e-2, 1e-2.5 .. 1e-5 as ClampedInverse chooses its clamp. `rows`
  /// must outlive this object.
  /// Throws Error(invalid_argument) for a damping below least_damping and for more than most_functions functions,
  /// Error(numerical_failure) if all functions are zero at all held points, and what the context throws.
  DampedInverse(const FunctionRows& rows, const std::vector<PointId>& held, const Options& options, const RunContext& context);

  /// Throws as the constructor does for too many functions.
  static Bytes estimate(const FunctionRows& rows, const std::vector<PointId>& held);

  double damping() const { return damping_; }
  Solution solution(const Eigen::MatrixXd& h) const override;
  Eigen::MatrixXd adjoint(const Eigen::MatrixXd& g) const override;
  Eigen::VectorXd uncertainty(std::size_t kind, const Eigen::VectorXd& parts, const Sizes& sizes) const override;
  double condition() const override { return 1 / damping_; }
  std::size_t bytes() const override;
  std::string note() const override;

 private:
  void factor(double damping, const RunContext& context);
  double automatic(const Typical& typical, const RunContext& context);
  Eigen::VectorXd at_held(const Eigen::VectorXd& w) const;
  Eigen::VectorXd transposed(const Eigen::VectorXd& h) const;
  Eigen::VectorXd fitted(const Eigen::VectorXd& h) const;
  Eigen::VectorXd refined(const Eigen::VectorXd& b) const;

  const FunctionRows rows_;
  const std::vector<PointId> held_;
  const std::vector<std::int64_t> active_;
  std::vector<std::int64_t> place_;  ///< of each function among the active ones, or -1
  SparseMatrix gram_;                ///< lower triangle of Phi^T Phi, active functions; empty once it is factored
  double largest_ = 0, damping_ = 0;
  std::vector<Eigen::VectorXd> growth_;  ///< of each kind of checked sums the norms of their rows
  std::unique_ptr<const SparseCholesky> factor_;
};

}  // namespace deform
