// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Dense>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// Sparse Cholesky factorization P A P^T = L L^T of a symmetric positive definite matrix (CHOLMOD, supernodal; Chen et al. 2008).
/// Any number of threads may solve at once: the factor is only read, each solve has its own workspace.
class SparseCholesky {
 public:
  /// What factoring `lower` will need: from the symbolic analysis alone, so cheap and exact to a few percent.
  struct Estimate {
    std::size_t factor_bytes = 0, peak_bytes = 0;
    double flops = 0;
  };
  static Estimate estimate(const SparseMatrix& lower, std::span<const std::int64_t> order = {});
  /// A fill-reducing elimination order: that of the constructor without one.
  static std::vector<std::int64_t> fill_reducing_order(const SparseMatrix& lower);

  /// Only the lower triangle of `lower` is read. Throws Error(numerical_failure) naming the column when the matrix is not
  /// positive definite, Error(out_of_budget) when memory runs out, and what the context throws.
  explicit SparseCholesky(const SparseMatrix& lower, const RunContext& context = {});
  /// With an elimination order: order[i] is the row that comes i-th (a permutation of all rows).
  SparseCholesky(const SparseMatrix& lower, std::span<const std::int64_t> order, const RunContext& context = {});
  ~SparseCholesky();
  SparseCholesky(SparseCholesky&&) noexcept;
  SparseCholesky& operator=(SparseCholesky&&) noexcept;

  std::size_t size() const;
  std::size_t bytes() const;
  double flops() const;  ///< of factoring
  /// The elimination order.
  std::vector<std::int64_t> order() const;
  /// The rows and columns of L that were eliminated last: with A = [A_11 .; A_21 A_22] in elimination order, `count` rows of
  /// A_22, L_22 L_22^T = A_22 - A_21 A_11^-1 A_21^T. Lower triangle, count x count.
  Eigen::MatrixXd trailing(std::size_t count) const;
  /// Rough reciprocal condition: (smallest / largest diagonal entry of L)^2.
  double reciprocal_condition() const;

  /// A x = b for every column; columns are independent of each other, bit for bit.
  Eigen::MatrixXd solve(const Eigen::Ref<const Eigen::MatrixXd>& b) const;
  void solve_in_place(Eigen::Ref<Eigen::MatrixXd> b) const;

 private:
  struct Factor;
  std::unique_ptr<Factor> factor_;
};

}  // namespace deform
