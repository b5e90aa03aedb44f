// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/reduced_energy.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "core/base/parallel.h"
#include "core/deformers/constrained/dense_rows.h"
#include "core/numerics/dense/lapack.h"

namespace deform {

namespace {

/// The matrix without the rows and columns of `chosen` (ascending); `kept` are those that stay.
SparseMatrix without(const SparseMatrix& lower, const std::vector<std::int64_t>& kept) {
  std::vector<std::int64_t> place(static_cast<std::size_t>(lower.rows()), -1);
  for (std::size_t i = 0; i < kept.size(); ++i) place[static_cast<std::size_t>(kept[i])] = static_cast<std::int64_t>(i);
  std::vector<Eigen::Triplet<double, std::int64_t>> entries;
  for (const std::int64_t c : kept) {
    for (SparseMatrix::InnerIterator it(lower, c); it; ++it) {
      const std::int64_t row = place[static_cast<std::size_t>(it.row())];
      if (row >= 0) entries.emplace_back(row, place[static_cast<std::size_t>(c)], it.value());
    }
  }
  SparseMatrix result(static_cast<std::int64_t>(kept.size()), static_cast<std::int64_t>(kept.size()));
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

/// Everything else first, then the chosen.
std::vector<std::int64_t> chosen_last(const SparseMatrix& lower, const std::vector<std::int64_t>& chosen) {
  std::vector<std::int64_t> kept;
  std::size_t next = 0;
  for (std::int64_t j = 0; j < lower.rows(); ++j) {
    if (next < chosen.size() && chosen[next] == j) {
      ++next;
    } else {
      kept.push_back(j);
    }
  }
  std::vector<std::int64_t> order;
  for (const std::int64_t i : SparseCholesky::fill_reducing_order(without(lower, kept))) {
    order.push_back(kept[static_cast<std::size_t>(i)]);
  }
  order.insert(order.end(), chosen.begin(), chosen.end());
  return order;
}

/// The end of the factor with that order is the factor of the Schur complement.
Eigen::MatrixXd schur_complement(const SparseMatrix& lower, const std::vector<std::int64_t>& chosen, const RunContext& context) {
  const std::vector<std::int64_t> order = chosen_last(lower, chosen);
  const Eigen::MatrixXd L = SparseCholesky(lower, order, context).trailing(chosen.size());
  return L.triangularView<Eigen::Lower>() * L.transpose();
}

SparseMatrix lower_of(const Eigen::MatrixXd& dense) {
  const Eigen::Index n = dense.rows();
  SparseMatrix result(n, n);
  Eigen::Matrix<std::int64_t, Eigen::Dynamic, 1> counts(n);
  for (Eigen::Index j = 0; j < n; ++j) counts[j] = n - j;
  result.reserve(counts);
  for (Eigen::Index j = 0; j < n; ++j) {
    for (Eigen::Index i = j; i < n; ++i) result.insert(i, j) = dense(i, j);
  }
  result.makeCompressed();
  return result;
}

}  // namespace

ReducedEnergy::ReducedEnergy(const EnergySolver& solver, std::vector<std::int64_t> chosen, std::size_t memory_limit,
                             const RunContext& context)
    : solver_(solver), functions_(std::move(chosen)) {
  dense_ = is_dense(functions_.size(), solver_.unknowns());
  if (!dense_) {
    functions_ = {};
    return;
  }
  matrix_ = lower_of(schur_complement(solver_.matrix(), functions_, context));
  factor_ = std::make_unique<const SparseCholesky>(EnergySolver::factored(matrix_, memory_limit, context));
}

bool ReducedEnergy::affordable_basis(std::size_t points, std::size_t functions, std::size_t factor_entries) {
  constexpr double most_operations = 4e11;
  const auto u = static_cast<double>(points), k = static_cast<double>(functions);
  return points <= most_points && u * (4 * static_cast<double>(factor_entries) + 2 * u * k) <= most_operations;
}

/// With C = V A^-1 V^T = L L^T, of which the pivoted factor has the first rows L_1 at the pivots, W = A^-1 V_1^T L_1^-T has the
/// energy I, and V W = L. As rounding grows with the condition of L_1, energy and values are computed from W.
ReducedEnergy::ReducedEnergy(const EnergySolver& solver, const Eigen::MatrixXd& V, std::size_t memory_limit,
                             const RunContext& context)
    : solver_(solver), dense_(true) {
  constexpr std::size_t columns_per_task = 64;
  constexpr double negligible = 1e-14;  // of the largest response
  Eigen::MatrixXd X = V.transpose();    // A^-1 V^T
  parallel_for(context, static_cast<std::size_t>(X.cols()), columns_per_task, [&](std::size_t begin, std::size_t end) {
    solver_.factor().solve_together_in_place(
        X.middleCols(static_cast<Eigen::Index>(begin), static_cast<Eigen::Index>(end - begin)));
  });
  lapack::use_one_thread();
  const auto u = static_cast<int>(V.rows()), k = static_cast<int>(V.cols());
  Eigen::MatrixXd C(u, u);
  cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, u, u, k, 1.0, V.data(), u, X.data(), k, 0.0, C.data(), u);
  context.check();
  const double tolerance = negligible * C.diagonal().maxCoeff();
  std::vector<int> pivots(static_cast<std::size_t>(u));
  std::vector<double> work(2 * static_cast<std::size_t>(u));
  int rank = 0, info = 0;
  dpstrf_("L", &u, C.data(), &u, pivots.data(), &rank, &tolerance, work.data(), &info);
  basis_.resize(k, rank);
  for (int i = 0; i < rank; ++i) basis_.col(i) = X.col(pivots[static_cast<std::size_t>(i)] - 1);
  cblas_dtrsm(CblasColMajor, CblasRight, CblasLower, CblasTrans, CblasNonUnit, k, rank, 1.0, C.data(), u, basis_.data(), k);
  const Eigen::MatrixXd forces = solver_.matrix().selfadjointView<Eigen::Lower>() * basis_;
  matrix_ = lower_of(transposed_product(basis_, forces));
  factor_ = std::make_unique<const SparseCholesky>(EnergySolver::factored(matrix_, memory_limit, context));
}

/// The lower triangle, and its factor: one block.
std::size_t ReducedEnergy::dense_bytes(std::size_t chosen) {
  const std::size_t lower = chosen * (chosen + 1) / 2 * (sizeof(double) + sizeof(std::int64_t));
  return lower + chosen * chosen * sizeof(double) + 64 * (chosen + 1) * sizeof(std::int64_t);
}

/// Beside these the full matrix, or the permuted copies of the lower triangle.
std::size_t ReducedEnergy::dense_peak_bytes(std::size_t chosen) {
  return dense_bytes(chosen) + 2 * chosen * (chosen + 1) * sizeof(double) + chosen * chosen * sizeof(double);
}

SparseCholesky::Estimate ReducedEnergy::estimate(const SparseMatrix& matrix, const std::vector<std::int64_t>& chosen) {
  if (!is_dense(chosen.size(), static_cast<std::size_t>(matrix.rows()))) return {};
  SparseCholesky::Estimate result = SparseCholesky::estimate(matrix, chosen_last(matrix, chosen));
  const auto n = static_cast<double>(chosen.size());
  result.factor_bytes = dense_bytes(chosen.size());
  result.peak_bytes =
      std::max(result.peak_bytes + chosen.size() * chosen.size() * sizeof(double), dense_peak_bytes(chosen.size()));
  result.flops += n * n * n / 3;
  return result;
}

std::size_t ReducedEnergy::bytes() const {
  const std::size_t basis = static_cast<std::size_t>(basis_.size()) * sizeof(double);
  return dense_ ? sparse_bytes(matrix_) + factor_->bytes() + functions_.size() * sizeof(std::int64_t) + basis : 0;
}

Eigen::MatrixXd ReducedEnergy::restricted(const Eigen::MatrixXd& w) const {
  if (!dense_) return w;
  Eigen::MatrixXd result(static_cast<Eigen::Index>(size()), w.cols());
  for (std::size_t i = 0; i < size(); ++i) result.row(static_cast<Eigen::Index>(i)) = w.row(functions_[i]);
  return result;
}

Eigen::MatrixXd ReducedEnergy::times(const Eigen::MatrixXd& v) const { return matrix().selfadjointView<Eigen::Lower>() * v; }

void ReducedEnergy::solve_in_place(Eigen::Ref<Eigen::MatrixXd> b) const {
  (dense_ ? *factor_ : solver_.factor()).solve_in_place(b);
}

Eigen::MatrixXd ReducedEnergy::spread(const Eigen::MatrixXd& v) const {
  if (!dense_) return v;
  if (basis_.size() > 0) return dense_product(basis_, v);
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(solver_.unknowns()), v.cols());
  for (std::size_t i = 0; i < size(); ++i) result.row(functions_[i]) = v.row(static_cast<Eigen::Index>(i));
  return result;
}

/// Returns A^-1 E S v: the response of all coefficients to the forces that hold the chosen ones.
Eigen::MatrixXd ReducedEnergy::extended(const Eigen::MatrixXd& v, const RunContext& context) const {
  if (!dense_) return v;
  return basis_.size() > 0 ? spread(v) : solver_.inverse(spread(times(v)), context);
}

}  // namespace deform
