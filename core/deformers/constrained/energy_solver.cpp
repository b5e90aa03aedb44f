// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/energy_solver.h"

#include <algorithm>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"

namespace deform {

namespace {

// Diagonal of B^T W B over that of K. Stiffer ones bend the functions to reach points that they cannot (1e6 inverts elements of
// pipe_hex); what is left is interpolated.
constexpr double multiplier_ratio = 1e2;

template <typename Matrix>
std::size_t bytes_of(const Matrix& matrix) {
  return static_cast<std::size_t>(matrix.nonZeros()) * (sizeof(double) + sizeof(std::int64_t)) +
         static_cast<std::size_t>(matrix.outerSize() + 1) * sizeof(std::int64_t);
}

/// Without the room for more that sums and products leave.
void squeeze(SparseMatrix& matrix) {
  matrix.makeCompressed();
  matrix.data().squeeze();
}

EnergySolver::Problem&& squeezed(EnergySolver::Problem& problem) {
  squeeze(problem.energy);
  squeeze(problem.coupling);
  return std::move(problem);
}

}  // namespace

EnergySolver::Problem::Problem(Problem&& other) : enforcement(other.enforcement), weights(std::move(other.weights)) {
  energy.swap(other.energy);
  coupling.swap(other.coupling);
}

std::size_t sparse_bytes(const SparseMatrix& matrix) { return bytes_of(matrix); }
std::size_t sparse_bytes(const SparseRows& matrix) { return bytes_of(matrix); }

Eigen::VectorXd multiplier_weights(const SparseMatrix& energy, const SparseMatrix& transposed, const Eigen::VectorXd& shares,
                                   TouchedFunctions rule) {
  // As a fraction of the largest: splines reach points on the planes between their spans with 0 or with the cube of a rounding,
  // and coordinates across a plane of points are 0 or a rounding.
  constexpr double negligible = 1e-20;
  Eigen::VectorXd squares = Eigen::VectorXd::Zero(energy.rows());
  for (std::int64_t c = 0; c < transposed.outerSize(); ++c) {
    for (SparseMatrix::InnerIterator it(transposed, c); it; ++it) squares[it.row()] += shares[c] * it.value() * it.value();
  }
  const double stiffness = energy.diagonal().sum() / static_cast<double>(std::max<std::int64_t>(1, energy.rows()));
  const double least = rule == TouchedFunctions::by_size && squares.size() > 0 ? negligible * squares.maxCoeff() : 0;
  double touched = 0;
  for (const double square : squares) touched += square > 0 ? square / (square + least) : 0;
  const double mean = squares.sum() / std::max(1.0, touched);
  return (mean > 0 && stiffness > 0 ? multiplier_ratio * stiffness / mean : 1) * shares;
}

SparseMatrix EnergySolver::matrix_of(const Problem& problem) {
  if (problem.enforcement == HandleEnforcement::eliminated || problem.coupling.cols() == 0) return {};
  // In place: Eigen's product with a diagonal matrix grows by and by, which takes half as much again.
  SparseMatrix weighted = problem.coupling;
  for (Eigen::Index j = 0; j < weighted.cols(); ++j) {
    for (SparseMatrix::InnerIterator it(weighted, j); it; ++it) it.valueRef() *= problem.weights[j];
  }
  const SparseMatrix square = weighted * SparseMatrix(problem.coupling.transpose());
  SparseMatrix result = problem.energy + SparseMatrix(square.triangularView<Eigen::Lower>());
  squeeze(result);
  return result;
}

SparseCholesky EnergySolver::factored(const SparseMatrix& matrix, std::size_t memory_limit, const RunContext& context) {
  if (memory_limit != 0) {
    const SparseCholesky::Estimate estimate = SparseCholesky::estimate(matrix);
    if (estimate.peak_bytes > memory_limit) {
      throw Error(ErrorCode::out_of_budget, "factoring " + std::to_string(matrix.rows()) + " unknowns needs " +
                                                std::to_string((estimate.peak_bytes >> 20) + 1) + " MiB, available are " +
                                                std::to_string(memory_limit >> 20) +
                                                " MiB; use larger fixed regions, fewer samples or centres, or a smaller cover");
    }
  }
  try {
    return SparseCholesky(matrix, context);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::numerical_failure) throw;
    throw Error(ErrorCode::numerical_failure, std::string("the deformation is not determined by its handles and fixed points (") +
                                                  error.what() +
                                                  "); fix more points, or give both stretching and bending a weight");
  }
}

EnergySolver::EnergySolver(Problem problem, std::size_t memory_limit, const RunContext& context)
    : problem_(squeezed(problem)), matrix_(matrix_of(problem_)), factor_(factored(matrix(), memory_limit, context)) {}

std::size_t EnergySolver::bytes() const {
  return factor_.bytes() + sparse_bytes(problem_.energy) + sparse_bytes(problem_.coupling) + sparse_bytes(matrix_) +
         static_cast<std::size_t>(problem_.weights.size()) * sizeof(double);
}

Eigen::MatrixXd EnergySolver::right_side(const Eigen::MatrixXd& h) const {
  if (problem_.enforcement == HandleEnforcement::eliminated) return problem_.coupling * h;
  return problem_.coupling * (problem_.weights.asDiagonal() * h);
}

void EnergySolver::solve_columns(Eigen::MatrixXd& b, const RunContext& context) const {
  parallel_for(context, static_cast<std::size_t>(b.cols()), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t c = begin; c < end; ++c) factor_.solve_in_place(b.col(static_cast<Eigen::Index>(c)));
  });
}

Eigen::MatrixXd EnergySolver::loads(const Eigen::MatrixXd& h, const RunContext& context) const {
  Eigen::MatrixXd u = h;
  for (int step = 1; problem_.enforcement == HandleEnforcement::multipliers && step < multiplier_steps; ++step) {
    context.check();
    Eigen::MatrixXd w = right_side(u);
    solve_columns(w, context);
    u += h - problem_.coupling.transpose() * w;
  }
  return u;
}

Eigen::MatrixXd EnergySolver::inverse(Eigen::MatrixXd b, const RunContext& context) const {
  solve_columns(b, context);
  return b;
}

Eigen::MatrixXd EnergySolver::solve_loads(const Eigen::MatrixXd& u, const RunContext& context) const {
  return inverse(right_side(u), context);
}

Eigen::MatrixXd EnergySolver::solve(const Eigen::MatrixXd& h, const RunContext& context) const {
  return solve_loads(loads(h, context), context);
}

/// From K and B themselves, not from the matrix that was rounded when it was assembled.
Eigen::MatrixXd EnergySolver::uncertainty(const Eigen::MatrixXd& u, const Eigen::MatrixXd& w, const RunContext& context) const {
  using Column = Eigen::Matrix<long double, Eigen::Dynamic, 1>;
  const SparseMatrix &K = problem_.energy, &B = problem_.coupling;
  const bool eliminated = problem_.enforcement == HandleEnforcement::eliminated;
  Eigen::MatrixXd residual(w.rows(), w.cols());
  parallel_for(context, static_cast<std::size_t>(w.cols()), 1, [&](std::size_t begin, std::size_t end) {
    for (auto c = static_cast<Eigen::Index>(begin); c < static_cast<Eigen::Index>(end); ++c) {
      Column r = Column::Zero(w.rows());
      for (std::int64_t j = 0; j < B.outerSize(); ++j) {
        long double load = u(j, c);
        if (!eliminated) {
          long double value = 0;
          for (SparseMatrix::InnerIterator it(B, j); it; ++it) value += static_cast<long double>(it.value()) * w(it.row(), c);
          load = problem_.weights[j] * (load - value);
        }
        for (SparseMatrix::InnerIterator it(B, j); it; ++it) r[it.row()] += it.value() * load;
      }
      for (std::int64_t j = 0; j < K.outerSize(); ++j) {
        for (SparseMatrix::InnerIterator it(K, j); it; ++it) {
          r[it.row()] -= static_cast<long double>(it.value()) * w(j, c);
          if (it.row() != j) r[j] -= static_cast<long double>(it.value()) * w(it.row(), c);
        }
      }
      residual.col(c) = r.cast<double>();
    }
  });
  return inverse(std::move(residual), context);
}

/// With S = B A^-1 B^T, u = q(S W) h for a polynomial q, and the solution is A^-1 B^T W u. W q(S W) is symmetric, so the
/// transpose is W q(S W) B A^-1 g: the same steps, from B A^-1 g.
Eigen::MatrixXd EnergySolver::adjoint(const Eigen::MatrixXd& g, const RunContext& context) const {
  Eigen::MatrixXd w = g;
  solve_columns(w, context);
  const Eigen::MatrixXd v = problem_.coupling.transpose() * w;
  if (problem_.enforcement == HandleEnforcement::eliminated) return v;
  Eigen::MatrixXd u = v;
  for (int step = 1; problem_.enforcement == HandleEnforcement::multipliers && step < multiplier_steps; ++step) {
    context.check();
    w = right_side(u);
    solve_columns(w, context);
    u += v - problem_.coupling.transpose() * w;
  }
  return problem_.weights.asDiagonal() * u;
}

}  // namespace deform
