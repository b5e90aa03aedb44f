// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained/constrained_points.h"
#include "core/deformers/constrained/reduced_energy.h"

namespace deform {

/// The coefficients of least energy plus weighted squared distances of the points from given targets (thesis 8.5, eq. 8.16).
/// Each set that moves with its points has its translation c as one more unknown, min over c of |x_i - y_i - c|^2, which gives
/// the solution of the thesis' mean-centred form with a sparse positive definite matrix:
///   [ S + sum g Phi^T Phi   . ]     one row -g 1^T Phi_t per translation
///   [ -g 1^T Phi_t        g n ]
/// Immutable; any thread.
class GlobalStep {
 public:
  /// Both must outlive this. Throws as EnergySolver does.
  GlobalStep(const ConstrainedPoints& points, const ReducedEnergy& energy, std::size_t memory_limit, const RunContext& context);

  /// r x 3 for the right-hand side `top` (empty: zero) plus what the targets (displacements of the points; empty: none) pull.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& top, const std::vector<Vec3>& targets, const RunContext& context) const;

  const SparseCholesky& factor() const { return *factor_; }

 private:
  SparseMatrix matrix(std::int64_t size) const;

  const ConstrainedPoints& points_;
  const ReducedEnergy& energy_;
  std::vector<std::int64_t> translation_;  ///< per set: row of its translation, or -1
  std::unique_ptr<const SparseCholesky> factor_;
};

}  // namespace deform
