#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/interpolation/solver.h"
#include "core/numerics/kernels/kernel.h"
#include "core/numerics/kernels/polynomial.h"

namespace deform {

class IncrementalQr;
class IterativeSystem;

/// One factorization of the bordered RBF system (thesis eq. 3.9, 3.10)
///
///   [ Phi  P ] [w]   [f]      Phi_ij = phi(|x_i - x_j|), m x m
///   [ P^T  0 ] [c] = [g]      P_ij = p_j(x_i), m x q of full rank
///
/// Immutable after construction; any number of threads may solve at once.
class SaddleFactor {
 public:
  virtual ~SaddleFactor() = default;
  /// B = [f; g], (m + q) x columns, becomes [w; c].
  virtual void solve(Eigen::MatrixXd& B) const = 0;
  virtual std::size_t bytes() const = 0;
  /// Estimate of the 1-norm condition of the factored matrix (of the projected one for Cholesky).
  virtual double condition() const = 0;
};

/// What every back-end assembles its matrix from. Must outlive the construction of a factor, not the factor.
struct SaddleProblem {
  RadialKernel kernel;
  std::span<const Vec3> centres;
  const PolynomialSpace& polynomials;
};

/// Back-ends. Null when the matrix is not positive definite to working precision (Cholesky). Throw Error(numerical_failure) when
/// it is singular, cancelled, deadline_exceeded.
std::unique_ptr<SaddleFactor> factor_cholesky(const SaddleProblem& problem, const RunContext& context);
std::unique_ptr<SaddleFactor> factor_ldlt(const SaddleProblem& problem, const RunContext& context);
std::unique_ptr<SaddleFactor> factor_lu(const SaddleProblem& problem, const RunContext& context);

/// What `automatic` stands for; Cholesky still has its fallback.
Solver chosen_solver(Solver solver, Kernel kernel, std::size_t centres);

struct InterpolationOptions {
  RadialKernel kernel;  ///< with a parity: values, polynomials and interpolants have it too (not for the iterative solver)
  int polynomial_degree = 1;
  Solver solver = Solver::automatic;
  std::size_t memory_limit = 0;  ///< bytes that the fallback, or incremental QR, may take; 0 = unlimited
  /// Of incremental QR: values (m x columns) that the centres are chosen for, see IncrementalQrOptions.
  Eigen::MatrixXd samples;
  double sample_tolerance = 0;
  std::size_t columns_per_field = 3;
  CentreOrder order = CentreOrder::farthest_point;
};

/// Interpolants of some columns of values, and how good they are.
struct Interpolants {
  /// (m + q) x columns: weights, then those of the polynomials; of incremental QR k weights, those of its first k centres.
  Eigen::MatrixXd coefficients;
  /// Iterative: largest |interpolant - value| over the centres and columns; incremental QR: largest length of a row of errors
  /// over the points; else 0, not measured.
  double residual = 0;
  bool converged = true;  ///< iterative: residual <= tolerance; incremental QR: RMS error <= tolerance
  int iterations = 0;
  int order = 0;         ///< iterative: of the fast sums that are good enough for these weights at the centres
  double tolerance = 0;  ///< that was asked for, in the units of the values
};

/// An RBF interpolant with everything but the values prepared. Coordinates should be of unit size.
class InterpolationSystem {
 public:
  /// Throws Error(numerical_failure) when the solver breaks down, out_of_budget, cancelled, deadline_exceeded.
  InterpolationSystem(std::vector<Vec3> centres, const InterpolationOptions& options, const RunContext& context);

  ~InterpolationSystem();

  std::size_t size() const { return centres_.size(); }  ///< m
  /// How many of them may have a weight: of incremental QR the prepared ones, else all.
  std::size_t weighted() const;
  const std::vector<Vec3>& centres() const { return centres_; }
  const RadialKernel& kernel() const { return kernel_; }
  const PolynomialSpace& polynomials() const { return polynomials_; }
  Solver solver() const { return solver_; }                                ///< the one used
  double condition() const { return factor_ ? factor_->condition() : 0; }  ///< 0 = not estimated (iterative)
  std::size_t bytes() const;
  const std::vector<std::string>& notes() const { return notes_; }

  /// Interpolants of the values F (m x columns) at the centres. `tolerance`, in the units of the values, is for the solvers that
  /// have one: of the iterative one for every column, of incremental QR for the RMS error of one field; the others always deliver
  /// all digits.
  Interpolants interpolate(const Eigen::MatrixXd& F, double tolerance, const RunContext& context = {}) const;
  /// Their values: n x columns, row by row. Of the iterative solver those of the interpolants to half their tolerance, measured
  /// at samples of the points.
  std::vector<double> values(const Interpolants& interpolants, std::span<const Vec3> points, const RunContext& context) const;
  /// Row i = sum over places j of phi(|centre i - place j|) * weights[j]: m x columns, row by row; adjoint of the sums above. Of
  /// the iterative solver to 1e-11 of the largest.
  std::vector<double> sums_at_centres(std::span<const Vec3> places, std::span<const double> weights, std::size_t columns,
                                      const RunContext& context) const;
  /// Adjoint of "values F at the centres to coefficients": B ((m + q) x columns, derivatives by weights and by coefficients of
  /// the polynomials) to m x columns. Of incremental QR with all its centres.
  Eigen::MatrixXd adjoint(Eigen::MatrixXd B, const RunContext& context = {}) const;

  /// Both not for incremental QR (Error(internal)).
  /// F (m x columns) values at the centres -> (m + q) x columns weights and polynomial coefficients.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& F, const RunContext& context = {}) const;
  /// The same with right-hand sides for both parts, in place; the system is symmetric, so this serves adjoints. Refined with
  /// accurate residuals, at most twice: the result is right to its last digits as long as condition * eps is well below one,
  /// whichever the solver; the iterative one stops at 1e-10 of the largest value.
  void solve_saddle(Eigen::MatrixXd& B, const RunContext& context = {}) const;

  /// Upper bounds for m centres.
  static std::size_t factor_bytes(std::size_t m, Solver solver);
  static std::size_t peak_bytes(std::size_t m, Solver solver);

 private:
  std::vector<Vec3> centres_;
  RadialKernel kernel_;
  PolynomialSpace polynomials_;
  Solver solver_ = Solver::cholesky;
  std::vector<std::string> notes_;
  std::unique_ptr<SaddleFactor> factor_;              // or
  std::unique_ptr<const IterativeSystem> iterative_;  // or
  std::unique_ptr<const IncrementalQr> incremental_;
};

}  // namespace deform
