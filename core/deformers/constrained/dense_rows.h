// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>
#include <vector>

#include "core/base/types.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// A B (m x k times k x n), by BLAS on one core; quick also where n is small. Any thread.
Eigen::MatrixXd dense_product(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
/// A^T B (A is k x m, B k x n), as dense_product().
Eigen::MatrixXd transposed_product(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

/// An N x r matrix Phi = P V of which nearly all entries are nonzero: P (N x u) is sparse, V (u x r) is stored. Immutable; any
/// thread.
class DenseRows {
 public:
  DenseRows(Eigen::MatrixXd values, SparseRows spread) : values_(std::move(values)), spread_(std::move(spread)) {}

  const Eigen::MatrixXd& values() const { return values_; }  ///< V
  const SparseRows& spread() const { return spread_; }       ///< P
  std::size_t bytes() const;

  /// Phi v (N) for v of size r x 3.
  std::vector<Vec3> times(const Eigen::MatrixXd& v) const { return spread_out(dense_product(values_, v)); }
  /// P x (N) for x of size u x 3.
  std::vector<Vec3> spread_out(const Eigen::MatrixXd& x) const;
  /// Phi^T y, r x 3.
  Eigen::MatrixXd transposed_times(const std::vector<Vec3>& y) const;
  /// V^T Q V, r x r, for a sparse Q (u x u) that need not be symmetric.
  Eigen::MatrixXd product(const SparseMatrix& Q) const;

 private:
  Eigen::MatrixXd values_;
  SparseRows spread_;
};

}  // namespace deform
