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

/// Minimizes the energy plus the weighted squared distances of the points from given targets (thesis 8.5, eq. 8.16). Each set
/// whose projection moves with its points has its translation c as an additional unknown, min over c of |x_i - y_i - c|^2. This
/// is equivalent to the mean-centred form of the thesis, but has a sparse positive definite matrix:
///   [ S + sum g Phi^T Phi   . ]     one row -g 1^T Phi_t per translation
///   [ -g 1^T Phi_t        g n ]
/// Immutable; any thread.
class GlobalStep {
 public:
  /// Both must outlive this object. Throws as EnergySolver does.
  GlobalStep(const ConstrainedPoints& points, const ReducedEnergy& energy, std::size_t memory_limit, const RunContext& context);

  /// The solution, r x 3, for the right-hand side `top` (zero if empty) plus that of the targets (displacements of the points;
  /// none if empty).
  Eigen::MatrixXd solve(const Eigen::MatrixXd& top, const std::vector<Vec3>& targets, const RunContext& context) const;

  const SparseCholesky& factor() const { return *factor_; }

 private:
  SparseMatrix matrix(std::int64_t size) const;
  SparseMatrix dense_matrix(const DenseRows& phi, std::int64_t size) const;

  const ConstrainedPoints& points_;
  const ReducedEnergy& energy_;
  std::vector<std::int64_t> translation_;  ///< row of the translation of each set, or -1
  std::unique_ptr<const SparseCholesky> factor_;
};

}  // namespace deform
