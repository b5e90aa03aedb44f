// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sampling/subspace.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/base/parallel.h"
#include "core/numerics/dense/blocked_qr.h"
#include "core/numerics/dense/lapack.h"
#include "core/numerics/sparse/row_gram.h"

namespace deform {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr std::size_t qr_block = 64;
constexpr std::size_t columns_per_range = 64;

/// Column j of the lower triangle of Phi^T right; `sums` and `seen` are 0 before and after.
void gather_column(const SparseMatrix& phi, const SparseRows& right, Index j, std::vector<double>& sums, std::vector<char>& seen,
                   LowerColumn& out) {
  for (SparseMatrix::InnerIterator at(phi, j); at; ++at) {
    for (SparseRows::InnerIterator it(right, at.row()); it; ++it) {
      const auto i = static_cast<std::size_t>(it.col());
      if (it.col() < j) continue;
      if (!seen[i]) {
        seen[i] = 1;
        out.rows.push_back(it.col());
      }
      sums[i] += at.value() * it.value();
    }
  }
  std::sort(out.rows.begin(), out.rows.end());
  for (const std::int64_t row : out.rows) {
    const auto i = static_cast<std::size_t>(row);
    out.values.push_back(sums[i]);
    sums[i] = 0;
    seen[i] = 0;
  }
}

}  // namespace

MatrixXd orthonormal_columns(const MatrixXd& columns, const RunContext& context) {
  const auto rows = static_cast<std::size_t>(columns.rows());
  const auto most = std::min(rows, static_cast<std::size_t>(columns.cols()));
  BlockedQr qr(rows);
  while (qr.columns() < most) {
    const std::size_t first = qr.columns(), count = std::min(qr_block, most - first);
    const auto fill = [&](double* to) { std::copy_n(columns.data() + first * rows, count * rows, to); };
    if (qr.append(count, fill, context) < count) break;
  }
  MatrixXd Q = MatrixXd::Identity(columns.rows(), static_cast<Index>(qr.columns()));
  qr.apply(qr.panels(), Q);
  return Q;
}

SparseMatrix projected_lower(const SparseMatrix& E, const MatrixXd& phi, const RunContext& context) {
  lapack::use_one_thread();
  const Index n = phi.rows(), k = phi.cols();
  MatrixXd full = MatrixXd::Zero(k, k);
  parallel_for(context, static_cast<std::size_t>(k), columns_per_range, [&](std::size_t begin, std::size_t end) {
    const auto first = static_cast<Index>(begin), count = static_cast<Index>(end - begin);
    const MatrixXd right = E * phi.middleCols(first, count);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, static_cast<int>(k - first), static_cast<int>(count),
                static_cast<int>(n), 1, phi.data() + first * n, static_cast<int>(n), right.data(), static_cast<int>(n), 0,
                full.data() + first * k + first, static_cast<int>(k));
  });
  SparseMatrix lower(k, k);
  lower.resizeNonZeros(k * (k + 1) / 2);
  std::int64_t at = 0;
  for (Index j = 0; j < k; ++j) {
    lower.outerIndexPtr()[j] = at;
    for (Index i = j; i < k; ++i, ++at) {
      lower.innerIndexPtr()[at] = i;
      lower.valuePtr()[at] = full(i, j);
    }
  }
  lower.outerIndexPtr()[k] = at;
  return lower;
}

SparseMatrix projected_lower(const SparseMatrix& E, const SparseRows& phi, const RunContext& context) {
  const SparseMatrix columns = phi;
  context.check();
  const SparseRows right = SparseRows(E) * phi;
  const auto k = static_cast<std::size_t>(phi.cols());
  std::vector<LowerColumn> gathered(k);
  parallel_for(context, k, columns_per_range, [&](std::size_t begin, std::size_t end) {
    std::vector<double> sums(k, 0.0);
    std::vector<char> seen(k, 0);
    for (std::size_t j = begin; j < end; ++j) gather_column(columns, right, static_cast<Index>(j), sums, seen, gathered[j]);
  });
  return lower_matrix(gathered);
}

}  // namespace deform
