// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>

#include "core/base/run_context.h"
#include "core/numerics/sparse/sparse.h"
#include "core/numerics/sparse/sparse_cholesky.h"

namespace deform {

/// How prescribed displacements h enter the minimization over w.
enum class HandleEnforcement {
  eliminated,   ///< w^T K w - 2 w^T R h
  soft,         ///< w^T K w + |B w - h|^2 with a weight per row (thesis eq. 8.10, 8.14)
  multipliers,  ///< least w^T K w under B w = h (in the least squares sense where that cannot be)
};

/// The linear map from prescribed displacements to the coefficients of the deformation of least energy, one factorization.
///
/// Multipliers: the weighted system is solved a few times, each time with what is still missing added to the prescribed values
/// (method of multipliers; Hestenes 1969, Powell 1969), so the factor of a moderate weight serves and h is met to `accuracy`.
/// Immutable; any number of threads may solve at once. Results do not depend on the number of columns or threads.
class EnergySolver {
 public:
  struct Problem {
    Problem() = default;
    Problem(const Problem&) = default;
    Problem(Problem&& other);  // Eigen's sparse matrices are copied when they are moved
    Problem& operator=(const Problem&) = default;

    SparseMatrix energy;  ///< K, k x k, lower triangle
    HandleEnforcement enforcement = HandleEnforcement::eliminated;
    SparseMatrix coupling;    ///< k x m: R; or B^T
    Eigen::VectorXd weights;  ///< m, of the rows of B; not for elimination
  };
  static constexpr int multiplier_steps = 3;

  /// Throws Error(numerical_failure) when the matrix is singular; out_of_budget when factoring takes more than `memory_limit`
  /// bytes (0 = unlimited), and what the context throws.
  EnergySolver(Problem problem, std::size_t memory_limit, const RunContext& context);

  std::size_t unknowns() const { return static_cast<std::size_t>(problem_.energy.rows()); }
  std::size_t held() const { return static_cast<std::size_t>(problem_.coupling.cols()); }
  const Problem& problem() const { return problem_; }
  const SparseCholesky& factor() const { return factor_; }
  std::size_t bytes() const;

  /// The matrix that is factored: K, or K + B^T W B; lower triangle.
  const SparseMatrix& matrix() const { return matrix_.rows() > 0 ? matrix_ : problem_.energy; }
  /// What stands on the right: R h, or B^T W h; k x c from m x c.
  Eigen::MatrixXd right_side(const Eigen::MatrixXd& h) const;

  /// u (m x c) such that the solution for h is A^-1 right_side(u): h itself but for multipliers.
  Eigen::MatrixXd loads(const Eigen::MatrixXd& h, const RunContext& context) const;
  /// A^-1 b, k x c.
  Eigen::MatrixXd inverse(Eigen::MatrixXd b, const RunContext& context) const;
  /// A^-1 right_side(u): k x c.
  Eigen::MatrixXd solve_loads(const Eigen::MatrixXd& u, const RunContext& context) const;
  /// k x c from h (m x c).
  Eigen::MatrixXd solve(const Eigen::MatrixXd& h, const RunContext& context) const;
  /// How far w = solve_loads(u) with u = loads(h) may be off: the next step of refinement, with the residual in extended
  /// precision, and of the method of multipliers; k x c.
  Eigen::MatrixXd uncertainty(const Eigen::MatrixXd& h, const Eigen::MatrixXd& u, const Eigen::MatrixXd& w,
                              const RunContext& context) const;
  /// m x c from g (k x c): the transpose of solve().
  Eigen::MatrixXd adjoint(const Eigen::MatrixXd& g, const RunContext& context) const;

  /// K + B^T W B; empty when that is K itself.
  static SparseMatrix matrix_of(const Problem& problem);

  /// With the errors of the constructor.
  static SparseCholesky factored(const SparseMatrix& matrix, std::size_t memory_limit, const RunContext& context);

 private:
  void solve_columns(Eigen::MatrixXd& b, const RunContext& context) const;

  Problem problem_;
  SparseMatrix matrix_;  ///< empty when it is the energy
  SparseCholesky factor_;
};

/// A weight with which B^T B stands out against K, for multipliers: the same for all rows of B.
double multiplier_weight(const SparseMatrix& energy, const SparseMatrix& transposed);

/// Bytes of the arrays of a sparse matrix.
std::size_t sparse_bytes(const SparseMatrix& matrix);
std::size_t sparse_bytes(const SparseRows& matrix);

}  // namespace deform
