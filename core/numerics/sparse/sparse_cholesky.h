// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// Sparse Cholesky factorization P A P^T = L L^T of a symmetric positive definite matrix (CHOLMOD, supernodal; Chen et al. 2008).
/// Any number of threads may solve at once; each solve has its own workspace.
class SparseCholesky {
 public:
  /// The cost of factoring `lower`, from the symbolic analysis alone: cheap, and accurate to a few percent.
  struct Estimate {
    std::size_t factor_bytes = 0, peak_bytes = 0;
    double flops = 0;
  };
  static Estimate estimate(const SparseMatrix& lower, std::span<const std::int64_t> order = {});
  /// A fill-reducing elimination order, the one that the constructor uses by default.
  static std::vector<std::int64_t> fill_reducing_order(const SparseMatrix& lower);

  /// Reads only the lower triangle of `lower`. Throws Error(numerical_failure) naming the column if the matrix is not positive
  /// definite, Error(out_of_budget) if memory runs out, and what the context throws.
  explicit SparseCholesky(const SparseMatrix& lower, const RunContext& context = {});
  /// Uses a given elimination order, a permutation of all rows: order[i] is the row that is eliminated i-th.
  SparseCholesky(const SparseMatrix& lower, std::span<const std::int64_t> order, const RunContext& context = {});
  ~SparseCholesky();
  SparseCholesky(SparseCholesky&&) noexcept;
  SparseCholesky& operator=(SparseCholesky&&) noexcept;

  std::size_t size() const;
  std::size_t bytes() const;
  double flops() const;  ///< floating-point operations of the factorization
  /// The elimination order.
  std::vector<std::int64_t> order() const;
  /// The trailing `count` x `count` block L_22 of L (lower triangle). With A = [A_11 .; A_21 A_22] in elimination order, L_22
  /// L_22^T is the Schur complement A_22 - A_21 A_11^-1 A_21^T.
  Eigen::MatrixXd trailing(std::size_t count) const;
  /// A rough estimate of the reciprocal condition number: (smallest / largest diagonal entry of L)^2.
  double reciprocal_condition() const;

  /// Solves A x = b for every column. The result of a column does not depend on the others, bit for bit.
  Eigen::MatrixXd solve(const Eigen::Ref<const Eigen::MatrixXd>& b) const;
  void solve_in_place(Eigen::Ref<Eigen::MatrixXd> b) const;
  /// The same for many columns in several times less time. Their number decides the order of sums: columns differ from those of
  /// solve() by rounding.
  void solve_together_in_place(Eigen::Ref<Eigen::MatrixXd> b) const;

 private:
  void solve_in_place(Eigen::Ref<Eigen::MatrixXd> b, Eigen::Index at_once) const;

  struct Factor;
  std::unique_ptr<Factor> factor_;
};

}  // namespace deform
