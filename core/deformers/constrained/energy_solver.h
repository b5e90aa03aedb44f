// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>

#include "core/base/run_context.h"
#include "core/numerics/sparse/sparse.h"
#include "core/numerics/sparse/sparse_cholesky.h"

namespace deform {

/// How the prescribed displacements h enter the minimization over w.
enum class HandleEnforcement {
  eliminated,   ///< minimizes w^T K w - 2 w^T R h
  soft,         ///< minimizes w^T K w + |B w - h|^2 with weighted rows (thesis eq. 8.10, 8.14)
  multipliers,  ///< multiplier_steps steps towards the minimum of w^T K w subject to B w = h, see EnergySolver
};

/// The linear map from prescribed displacements to the coefficients of the deformation of least energy, with one factorization.
///
/// Multipliers: the weighted system is solved a few times, each time with the remaining misfit added to the prescribed values
/// (method of multipliers; Hestenes 1969, Powell 1969), so that a factor with a moderate weight suffices. The number of steps
/// belongs to the definition of the solution: where B w = h can be met, the steps are close to its minimum of energy; where it
/// cannot, because the functions are coarser than h, they are iterated Tikhonov regularization of the least-squares problem
/// (Engl, Hanke and Neubauer 1996, section 5.1), whose limit swings between the held points. Immutable; any number
/// of threads may solve at once. Results do not depend on the number of columns or threads.
class EnergySolver {
 public:
  struct Problem {
    Problem() = default;
    Problem(const Problem&) = default;
    Problem(Problem&& other);  // Eigen copies sparse matrices when they are moved
    Problem& operator=(const Problem&) = default;

    SparseMatrix energy;  ///< K, k x k, lower triangle
    HandleEnforcement enforcement = HandleEnforcement::eliminated;
    SparseMatrix coupling;    ///< k x m: R; or B^T
    Eigen::VectorXd weights;  ///< m weights of the rows of B; not for elimination
  };
  static constexpr int multiplier_steps = 3;

  /// Throws Error(numerical_failure) if the matrix is singular, out_of_budget if the factorization takes more than `memory_limit`
  /// bytes (0 = unlimited), and what the context throws.
  EnergySolver(Problem problem, std::size_t memory_limit, const RunContext& context);

  std::size_t unknowns() const { return static_cast<std::size_t>(problem_.energy.rows()); }
  std::size_t held() const { return static_cast<std::size_t>(problem_.coupling.cols()); }
  const Problem& problem() const { return problem_; }
  const SparseCholesky& factor() const { return factor_; }
  std::size_t bytes() const;

  /// The factored matrix A, that is K or K + B^T W B; lower triangle.
  const SparseMatrix& matrix() const { return matrix_.rows() > 0 ? matrix_ : problem_.energy; }
  /// The right-hand side R h or B^T W h: k x c from m x c.
  Eigen::MatrixXd right_side(const Eigen::MatrixXd& h) const;

  /// The loads u (m x c) such that the solution for h is A^-1 right_side(u). Equal to h except for multipliers.
  Eigen::MatrixXd loads(const Eigen::MatrixXd& h, const RunContext& context) const;
  /// A^-1 b, k x c.
  Eigen::MatrixXd inverse(Eigen::MatrixXd b, const RunContext& context) const;
  /// A^-1 right_side(u): k x c.
  Eigen::MatrixXd solve_loads(const Eigen::MatrixXd& u, const RunContext& context) const;
  /// The solution for h: k x c from m x c.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& h, const RunContext& context) const;
  /// Estimates the error of w = solve_loads(u) with u = loads(h), k x c: the next step of iterative refinement, with the residual
  /// in extended precision. Further steps of the method of multipliers are no part of it.
  Eigen::MatrixXd uncertainty(const Eigen::MatrixXd& u, const Eigen::MatrixXd& w, const RunContext& context) const;
  /// The transpose of solve(): m x c from g (k x c).
  Eigen::MatrixXd adjoint(const Eigen::MatrixXd& g, const RunContext& context) const;

  /// K + B^T W B; empty if that equals K.
  static SparseMatrix matrix_of(const Problem& problem);

  /// Factors a matrix; throws the errors of the constructor.
  static SparseCholesky factored(const SparseMatrix& matrix, std::size_t memory_limit, const RunContext& context);

 private:
  void solve_columns(Eigen::MatrixXd& b, const RunContext& context) const;

  Problem problem_;
  SparseMatrix matrix_;  ///< empty if it is the energy
  SparseCholesky factor_;
};

/// Which functions are counted as touched by the rows of B.
enum class TouchedFunctions {
  by_size,     ///< s / (s + 1e-20 max s) of each, with the sum s of the squares of its values: rounding does not change the count
  above_zero,  ///< those with a value that is not zero, be it a rounding; that of stored systems, up to version 0.2
};

/// The weights of the rows of B for multipliers: these shares (m), each greater than zero, times a number that is large enough
/// for B^T W B to dominate K: it makes the mean diagonal of B^T W B, over the functions that are touched, 100 times that of K.
Eigen::VectorXd multiplier_weights(const SparseMatrix& energy, const SparseMatrix& transposed, const Eigen::VectorXd& shares,
                                   TouchedFunctions rule = TouchedFunctions::by_size);

/// Bytes of the arrays of a sparse matrix.
std::size_t sparse_bytes(const SparseMatrix& matrix);
std::size_t sparse_bytes(const SparseRows& matrix);

}  // namespace deform
