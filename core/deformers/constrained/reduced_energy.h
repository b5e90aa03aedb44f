// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained/energy_solver.h"

namespace deform {

/// The energy of a deformation as a function of some of its coefficients, minimized over all others: with the unconstrained
/// solution u and the change v of the chosen coefficients, it is v^T S v above that of u. If few coefficients are chosen, S is
/// their dense Schur complement; otherwise all are chosen and S is the matrix A of the solver.
///
/// For points that move by V w with a dense V, of many functions, v are coefficients of a basis W instead, of the responses A^-1
/// V^T f to forces at these points: all changes that shapes can cause. It comes from the pivoted Cholesky factor of V A^-1 V^T,
/// up to what rounding leaves. Immutable; any thread.
class ReducedEnergy {
 public:
  static constexpr std::size_t most_dense = 1200;
  static constexpr std::size_t most_points = 6000;  ///< of a basis

  /// `chosen` is ascending; see function() for the coefficients in use. `solver` must outlive this object. Throws as
  /// EnergySolver does.
  ReducedEnergy(const EnergySolver& solver, std::vector<std::int64_t> chosen, std::size_t memory_limit,
                const RunContext& context);

  /// For points that move by V w (u x k).
  ReducedEnergy(const EnergySolver& solver, const Eigen::MatrixXd& V, std::size_t memory_limit, const RunContext& context);
  /// Whether the basis for so many points and functions, with the entries of the solver's factor, takes a few seconds.
  static bool affordable_basis(std::size_t points, std::size_t functions, std::size_t factor_entries);

  /// The memory, the peak memory of the construction and its operations, from symbolic analysis to a few percent.
  static SparseCholesky::Estimate estimate(const SparseMatrix& matrix, const std::vector<std::int64_t>& chosen);
  /// Whether S is dense for this number of chosen functions.
  static bool is_dense(std::size_t chosen, std::size_t unknowns) { return chosen <= most_dense && 2 * chosen < unknowns; }
  /// Upper bounds of the memory of a dense S and of the peak of its construction.
  static std::size_t dense_bytes(std::size_t chosen);
  static std::size_t dense_peak_bytes(std::size_t chosen);

  bool dense() const { return dense_; }
  std::size_t size() const {
    return basis_.size() > 0 ? static_cast<std::size_t>(basis_.cols()) : dense_ ? functions_.size() : solver_.unknowns();
  }
  /// W, k x r; empty if coefficients are chosen.
  const Eigen::MatrixXd& basis() const { return basis_; }
  /// The coefficient of the solver that is the i-th one here, without a basis.
  std::int64_t function(std::size_t i) const { return dense_ ? functions_[i] : static_cast<std::int64_t>(i); }
  /// S, lower triangle.
  const SparseMatrix& matrix() const { return dense_ ? matrix_ : solver_.matrix(); }
  std::size_t bytes() const;
  /// The elimination order of the factor of all coefficients.
  std::vector<std::int64_t> order() const { return solver_.factor().order(); }

  /// The chosen rows of w (k x c), without a basis.
  Eigen::MatrixXd restricted(const Eigen::MatrixXd& w) const;
  Eigen::MatrixXd times(const Eigen::MatrixXd& v) const;
  void solve_in_place(Eigen::Ref<Eigen::MatrixXd> b) const;
  /// The change of all coefficients for a change v when coefficients that are not chosen stay: k x c.
  Eigen::MatrixXd spread(const Eigen::MatrixXd& v) const;
  /// The change of all coefficients for a change v of the chosen ones: k x c, zero for v = 0.
  Eigen::MatrixXd extended(const Eigen::MatrixXd& v, const RunContext& context) const;

 private:
  const EnergySolver& solver_;
  std::vector<std::int64_t> functions_;
  Eigen::MatrixXd basis_;
  bool dense_ = false;
  SparseMatrix matrix_;                           ///< empty unless dense
  std::unique_ptr<const SparseCholesky> factor_;  ///< factor of S
};

}  // namespace deform
