#include "core/numerics/interpolation_system.h"

#include "core/base/error.h"
#include "core/numerics/packed_cholesky.h"
#include "core/numerics/residual.h"

namespace deform {

namespace {

constexpr std::size_t most_terms = 10;

std::string mebibytes(std::size_t bytes) { return std::to_string((bytes >> 20) + 1) + " MiB"; }

}  // namespace

const char* to_string(DenseSolver solver) {
  switch (solver) {
    case DenseSolver::automatic:
      return "automatic";
    case DenseSolver::cholesky:
      return "cholesky";
    case DenseSolver::ldlt:
      return "ldlt";
    case DenseSolver::lu:
      return "lu";
  }
  return "automatic";
}

InterpolationSystem::InterpolationSystem(std::vector<Vec3> centres, const InterpolationOptions& options,
                                         const RunContext& context)
    : centres_(std::move(centres)), kernel_(options.kernel), polynomials_(centres_, options.polynomial_degree) {
  const SaddleProblem problem{kernel_, centres_, polynomials_};
  solver_ = options.solver == DenseSolver::automatic ? DenseSolver::cholesky : options.solver;
  if (solver_ == DenseSolver::lu) factor_ = factor_lu(problem, context);
  if (solver_ == DenseSolver::ldlt) factor_ = factor_ldlt(problem, context);
  if (solver_ != DenseSolver::cholesky) return;
  factor_ = factor_cholesky(problem, context);
  if (factor_) return;
  const std::string reason = "Cholesky broke down: the system of " + std::to_string(size()) +
                             " centres is not positive definite to working precision (nearly coincident centres, or a shape "
                             "parameter that is too large)";
  if (options.solver == DenseSolver::cholesky) {
    throw Error(ErrorCode::numerical_failure, reason + "; use solver AUTOMATIC or LDLT");
  }
  const std::size_t needed = peak_bytes(size(), DenseSolver::ldlt);
  if (options.memory_limit != 0 && needed > options.memory_limit) {
    throw Error(ErrorCode::out_of_budget, reason + ", and LDL^T needs " + mebibytes(needed) + ", available are " +
                                              mebibytes(options.memory_limit) + "; remove nearly coincident centres");
  }
  solver_ = DenseSolver::ldlt;
  factor_ = factor_ldlt(problem, context);
  notes_.push_back(reason + "; LDL^T was used instead.");
}

Eigen::MatrixXd InterpolationSystem::solve(const Eigen::MatrixXd& F, const RunContext& context) const {
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(F.rows() + static_cast<Eigen::Index>(polynomials_.terms()), F.cols());
  B.topRows(F.rows()) = F;
  solve_saddle(B, context);
  return B;
}

void InterpolationSystem::solve_saddle(Eigen::MatrixXd& B, const RunContext& context) const {
  constexpr int most_steps = 2;
  constexpr double enough = 1e-15;
  const auto m = static_cast<Eigen::Index>(size());
  const Eigen::MatrixXd P = polynomials_.matrix(centres_);
  Eigen::MatrixXd X = B;
  factor_->solve(X);
  double last = X.norm();
  for (int step = 0; step < most_steps && last > 0; ++step) {
    context.check();
    Eigen::MatrixXd correction(X.rows(), X.cols());
    correction.topRows(m) = accurate_residual(kernel_, centres_, P, X, B.topRows(m), context);
    correction.bottomRows(P.cols()) =
        (B.bottomRows(P.cols()).cast<long double>() - P.cast<long double>().transpose() * X.topRows(m).cast<long double>())
            .cast<double>();
    factor_->solve(correction);
    const double size = correction.norm();
    // A factor without correct digits cannot refine.
    if (!(size < 0.5 * last)) break;
    X += correction;
    if (size <= enough * X.norm()) break;
    last = size;
  }
  B = std::move(X);
}

std::size_t InterpolationSystem::factor_bytes(std::size_t m, DenseSolver solver) {
  const std::size_t bordered = m + most_terms;
  const std::size_t side = 4 * most_terms * bordered * sizeof(double) + (std::size_t{1} << 12);
  if (solver == DenseSolver::lu) return bordered * bordered * sizeof(double) + side;
  if (solver == DenseSolver::ldlt) return bordered * (bordered + 1) / 2 * sizeof(double) + side;
  return PackedCholesky::bytes_for(m) + side;
}

std::size_t InterpolationSystem::peak_bytes(std::size_t m, DenseSolver solver) {
  const std::size_t bordered = m + most_terms;
  const std::size_t square = bordered * bordered * sizeof(double);
  std::size_t matrix = PackedCholesky::bytes_for(m);
  if (solver == DenseSolver::lu) matrix = square;
  if (solver == DenseSolver::ldlt)
    matrix = square + square / 2 + 64 * bordered * sizeof(double);  // the triangle beside the square
  return matrix + 8 * most_terms * bordered * sizeof(double) + (std::size_t{1} << 12);
}

}  // namespace deform
