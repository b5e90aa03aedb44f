// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/dense_interpolator.h"

#include <utility>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/numerics/dense/packed_cholesky.h"
#include "core/numerics/interpolation/value_errors.h"
#include "core/numerics/kernels/residual.h"

namespace deform {

namespace {

constexpr std::size_t most_terms = PolynomialSpace::most_terms;
constexpr double least_digits = 1e15;  // a condition with which refinement may fail to converge
constexpr char instead[] = "LDL^T of differences between close centres was used instead.";

}  // namespace

DenseInterpolator::DenseInterpolator(std::vector<Vec3> centres, const InterpolationOptions& options, const RunContext& context)
    : Interpolator(std::move(centres), options.kernel, options.polynomial_degree),
      solver_(options.solver == Solver::ldlt ? Solver::ldlt : Solver::cholesky) {
  const SaddleProblem problem{kernel_, centres_, polynomials_};
  factor_ = solver_ == Solver::ldlt ? factor_ldlt(problem, context) : factor_cholesky(problem, context);
  if (factor_ && (options.solver == Solver::cholesky || factor_->condition() <= least_digits)) return;
  if (solver_ == Solver::ldlt) {
    factor_.reset();  // before the next one takes memory
    factor_ = factor_differences(problem, context);
    return;
  }
  const std::size_t needed = peak_bytes(size(), Solver::ldlt);
  const bool too_large = options.memory_limit != 0 && needed > options.memory_limit;
  if (factor_) {
    if (too_large) return;
    notes_.push_back("The Cholesky factor of the system of " + std::to_string(size()) +
                     " centres has hardly a correct digit (nearly coincident centres, or a shape parameter that is too large); " +
                     instead);
    factor_.reset();
  } else {
    const std::string reason = "Cholesky broke down: the system of " + std::to_string(size()) +
                               " centres is not positive definite to working precision (nearly coincident centres, or a shape "
                               "parameter that is too large)";
    if (options.solver == Solver::cholesky) {
      throw Error(ErrorCode::numerical_failure, reason + "; use solver AUTOMATIC or LDLT");
    }
    if (too_large) {
      throw Error(ErrorCode::out_of_budget, reason + ", and LDL^T needs " + mebibytes(needed) + ", available are " +
                                                mebibytes(options.memory_limit) + "; remove nearly coincident centres");
    }
    notes_.push_back(reason + "; " + instead);
  }
  solver_ = Solver::ldlt;
  factor_ = factor_differences(problem, context);
}

Interpolants DenseInterpolator::interpolate(const Eigen::MatrixXd& F, double /*tolerance*/, const RunContext& context) const {
  return solve_saddle(with_side_conditions(F), context);
}

Eigen::MatrixXd DenseInterpolator::unrefined(const Eigen::MatrixXd& F) const {
  Eigen::MatrixXd X = with_side_conditions(F);
  factor_->solve(X);
  return X;
}

Eigen::MatrixXd DenseInterpolator::adjoint(Eigen::MatrixXd B, const RunContext& context) const {
  return solve_saddle(B, context).coefficients.topRows(static_cast<Eigen::Index>(size()));
}

Interpolants DenseInterpolator::solve_saddle(const Eigen::MatrixXd& B, const RunContext& context) const {
  constexpr double enough = 1e-15, contracting = 0.5;
  const auto m = static_cast<Eigen::Index>(size());
  const Eigen::MatrixXd P = polynomials_.matrix(centres_);
  Interpolants solution;
  Eigen::MatrixXd& X = solution.coefficients;
  X = B;
  factor_->solve(X);
  double last = X.norm(), rate = 0;
  for (int step = 0; step < most_refinements && last > 0; ++step) {
    context.check();
    Eigen::MatrixXd correction(X.rows(), X.cols());
    correction.topRows(m) = deform::accurate_residual(kernel_, centres_, centres_, P, X, B.topRows(m), context);
    correction.bottomRows(P.cols()) =
        (B.bottomRows(P.cols()).cast<long double>() - P.cast<long double>().transpose() * X.topRows(m).cast<long double>())
            .cast<double>();
    factor_->solve(correction);
    const double size = correction.norm();
    rate = size / last;
    solution.uncertainty = std::move(correction);
    if (!(rate < contracting)) {
      // Else the factor has no correct digits.
      solution.converged = refined_as_far_as_possible(step, size, X.norm());
      rate = contracting;
      break;
    }
    X += solution.uncertainty;
    // What the next correction would be decides only beyond the usual steps, whose results are those of before.
    if ((step + 1 < usual_refinements ? size : rate * size) <= enough * X.norm()) break;
    last = size;
  }
  // The next correction would be smaller by the rate again, and so on.
  solution.uncertainty *= rate / (1 - rate);
  if (!solution.converged) return solution;
  if (properties(kernel_.kernel).has_shape) {
    Eigen::MatrixXd rounded = rounding_of_values(B, m);
    factor_->solve(rounded);
    solution.uncertainty += rounded;
  }
  return solution;
}

std::size_t DenseInterpolator::bytes_for(std::size_t m, Solver solver) {
  const std::size_t bordered = m + most_terms;
  const std::size_t side = 4 * most_terms * bordered * sizeof(double) + (std::size_t{1} << 12);
  if (solver == Solver::ldlt) return bordered * (bordered + 1) / 2 * sizeof(double) + side;
  return PackedCholesky::bytes_for(m) + side;
}

std::size_t DenseInterpolator::peak_bytes(std::size_t m, Solver solver) {
  const std::size_t bordered = m + most_terms;
  const std::size_t square = bordered * bordered * sizeof(double);
  std::size_t matrix = PackedCholesky::bytes_for(m);
  if (solver == Solver::ldlt) matrix = square + square / 2 + 64 * bordered * sizeof(double);  // the triangle beside the square
  return matrix + 8 * most_terms * bordered * sizeof(double) + (std::size_t{1} << 12);
}

}  // namespace deform
