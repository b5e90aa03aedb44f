#include "core/numerics/interpolation/interpolation_system.h"

#include <algorithm>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/numerics/dense/packed_cholesky.h"
#include "core/numerics/fast_sums/checked_sums.h"
#include "core/numerics/interpolation/incremental_qr.h"
#include "core/numerics/interpolation/iterative_system.h"
#include "core/numerics/kernels/residual.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

namespace {

constexpr std::size_t most_terms = 10;
constexpr std::size_t most_dense = 20000;  // centres that `automatic` factors: 1.6 GB and half a minute
constexpr int adjoint_order = 12;          // of the sums to begin with
constexpr double adjoint_accuracy = 1e-11;

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

}  // namespace

const char* to_string(Solver solver) {
  switch (solver) {
    case Solver::automatic:
      return "automatic";
    case Solver::cholesky:
      return "cholesky";
    case Solver::ldlt:
      return "ldlt";
    case Solver::lu:
      return "lu";
    case Solver::iterative:
      return "iterative";
    case Solver::incremental_qr:
      return "incremental QR";
    case Solver::sparse_cholesky:
      return "sparse Cholesky";
  }
  return "automatic";
}

Solver chosen_solver(Solver solver, Kernel kernel, std::size_t centres) {
  if (solver != Solver::automatic) return solver;
  return centres > most_dense && properties(kernel).smooth ? Solver::iterative : Solver::cholesky;
}

InterpolationSystem::InterpolationSystem(std::vector<Vec3> centres, const InterpolationOptions& options,
                                         const RunContext& context)
    : centres_(std::move(centres)),
      kernel_(options.kernel),
      polynomials_(centres_, options.polynomial_degree, options.kernel.parity) {
  const SaddleProblem problem{kernel_, centres_, polynomials_};
  solver_ = chosen_solver(options.solver, kernel_.kernel, size());
  if (solver_ == Solver::iterative) {
    if (!kernel_.parity.none()) {
      throw Error(ErrorCode::invalid_argument, "solver: the iterative one has no images; give it all centres and their images");
    }
    iterative_ = std::make_unique<IterativeSystem>(centres_, kernel_, options.polynomial_degree, context);
    return;
  }
  if (solver_ == Solver::incremental_qr) {
    IncrementalQrOptions incremental;
    incremental.kernel = kernel_;
    incremental.polynomial_degree = options.polynomial_degree;
    incremental.most_centres = most_incremental_centres;
    incremental.memory_limit = options.memory_limit;
    incremental.samples = options.samples;
    incremental.sample_tolerance = options.sample_tolerance;
    incremental.columns_per_field = options.columns_per_field;
    incremental.order = options.order;
    incremental_ = std::make_unique<IncrementalQr>(centres_, incremental, context);
    return;
  }
  if (solver_ == Solver::lu) factor_ = factor_lu(problem, context);
  if (solver_ == Solver::ldlt) factor_ = factor_ldlt(problem, context);
  if (solver_ != Solver::cholesky) return;
  factor_ = factor_cholesky(problem, context);
  if (factor_) return;
  const std::string reason = "Cholesky broke down: the system of " + std::to_string(size()) +
                             " centres is not positive definite to working precision (nearly coincident centres, or a shape "
                             "parameter that is too large)";
  if (options.solver == Solver::cholesky) {
    throw Error(ErrorCode::numerical_failure, reason + "; use solver AUTOMATIC or LDLT");
  }
  const std::size_t needed = peak_bytes(size(), Solver::ldlt);
  if (options.memory_limit != 0 && needed > options.memory_limit) {
    throw Error(ErrorCode::out_of_budget, reason + ", and LDL^T needs " + mebibytes(needed) + ", available are " +
                                              mebibytes(options.memory_limit) + "; remove nearly coincident centres");
  }
  solver_ = Solver::ldlt;
  factor_ = factor_ldlt(problem, context);
  notes_.push_back(reason + "; LDL^T was used instead.");
}

InterpolationSystem::~InterpolationSystem() = default;

std::size_t InterpolationSystem::weighted() const { return incremental_ ? incremental_->prepared() : size(); }

std::size_t InterpolationSystem::bytes() const {
  if (incremental_) return incremental_->bytes() + centres_.size() * sizeof(Vec3);
  return (iterative_ ? iterative_->bytes() : factor_->bytes()) + centres_.size() * sizeof(Vec3);
}

Interpolants InterpolationSystem::interpolate(const Eigen::MatrixXd& F, double tolerance, const RunContext& context) const {
  if (incremental_) {
    IncrementalQr::Solution solution = incremental_->solve(F, tolerance);
    return {std::move(solution.coefficients), solution.largest_error, solution.converged};
  }
  if (!iterative_) return {solve(F, context)};
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(F.rows() + static_cast<Eigen::Index>(polynomials_.terms()), F.cols());
  B.topRows(F.rows()) = F;
  IterativeSystem::Solution solution = iterative_->solve(B, tolerance, context);
  return {
      std::move(solution.coefficients), solution.residual, solution.converged, solution.iterations, solution.order, tolerance};
}

std::vector<double> InterpolationSystem::values(const Interpolants& interpolants, std::span<const Vec3> points,
                                                const RunContext& context) const {
  if (incremental_) {
    IncrementalQr::Solution solution;
    solution.coefficients = interpolants.coefficients;
    solution.centres = static_cast<std::size_t>(interpolants.coefficients.rows()) - polynomials_.terms();
    return incremental_->values(solution, points, context);
  }
  const RowMajor rows = interpolants.coefficients;
  const auto columns = static_cast<std::size_t>(rows.cols());
  const std::span<const double> weights(rows.data(), size() * columns);
  const SumAccuracy accuracy{interpolants.order, 0.5 * interpolants.tolerance, 0};
  std::vector<double> result = iterative_ ? checked_sums(kernel_, points, centres_, weights, columns, accuracy, context)
                                          : kernel_sums(kernel_, points, centres_, weights, columns, context);
  add_polynomials(polynomials_, points, {rows.data() + size() * columns, polynomials_.terms() * columns}, result, context);
  return result;
}

std::vector<double> InterpolationSystem::sums_at_centres(std::span<const Vec3> places, std::span<const double> weights,
                                                         std::size_t columns, const RunContext& context) const {
  if (!iterative_) return kernel_sums(kernel_, centres_, places, weights, columns, context);
  return checked_sums(kernel_, centres_, places, weights, columns, {adjoint_order, 0, adjoint_accuracy}, context);
}

Eigen::MatrixXd InterpolationSystem::adjoint(Eigen::MatrixXd B, const RunContext& context) const {
  const auto m = static_cast<Eigen::Index>(size());
  if (!incremental_) {
    solve_saddle(B, context);  // symmetric
    return B.topRows(m);
  }
  const auto k = static_cast<Eigen::Index>(weighted());
  Eigen::MatrixXd chosen(k + B.rows() - m, B.cols());
  for (Eigen::Index j = 0; j < k; ++j) chosen.row(j) = B.row(incremental_->order()[static_cast<std::size_t>(j)]);
  chosen.bottomRows(B.rows() - m) = B.bottomRows(B.rows() - m);
  return incremental_->adjoint(chosen);
}

Eigen::MatrixXd InterpolationSystem::solve(const Eigen::MatrixXd& F, const RunContext& context) const {
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(F.rows() + static_cast<Eigen::Index>(polynomials_.terms()), F.cols());
  B.topRows(F.rows()) = F;
  solve_saddle(B, context);
  return B;
}

void InterpolationSystem::solve_saddle(Eigen::MatrixXd& B, const RunContext& context) const {
  if (iterative_) {
    B = iterative_->solve(B, 1e-10 * B.cwiseAbs().maxCoeff(), context).coefficients;
    return;
  }
  if (incremental_) throw Error(ErrorCode::internal, "incremental QR has no square system");
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

std::size_t InterpolationSystem::factor_bytes(std::size_t m, Solver solver) {
  if (solver == Solver::iterative) return IterativeSystem::bytes_for(m);
  if (solver == Solver::incremental_qr) return IncrementalQr::bytes_for(m, std::min<std::size_t>(m, most_incremental_centres));
  const std::size_t bordered = m + most_terms;
  const std::size_t side = 4 * most_terms * bordered * sizeof(double) + (std::size_t{1} << 12);
  if (solver == Solver::lu) return bordered * bordered * sizeof(double) + side;
  if (solver == Solver::ldlt) return bordered * (bordered + 1) / 2 * sizeof(double) + side;
  return PackedCholesky::bytes_for(m) + side;
}

std::size_t InterpolationSystem::peak_bytes(std::size_t m, Solver solver) {
  if (solver == Solver::iterative) return IterativeSystem::peak_bytes(m, 4);
  // Beside the factor the samples, what was made of them, and a request.
  if (solver == Solver::incremental_qr) return factor_bytes(m, solver) + 16 * (m + most_terms) * sizeof(double);
  const std::size_t bordered = m + most_terms;
  const std::size_t square = bordered * bordered * sizeof(double);
  std::size_t matrix = PackedCholesky::bytes_for(m);
  if (solver == Solver::lu) matrix = square;
  if (solver == Solver::ldlt) matrix = square + square / 2 + 64 * bordered * sizeof(double);  // the triangle beside the square
  return matrix + 8 * most_terms * bordered * sizeof(double) + (std::size_t{1} << 12);
}

}  // namespace deform
