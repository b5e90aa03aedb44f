// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/dense_rows.h"

#include <algorithm>

#include "core/numerics/dense/lapack.h"

namespace deform {
namespace {

/// The product with a matrix of so few columns reads A as often as that, some columns at a time, which stay in the cache:
/// products of matrices copy A first, which takes longer than all else then.
constexpr Eigen::Index few_columns = 4, columns_at_once = 32;

/// A B or A^T B.
Eigen::MatrixXd product(CBLAS_TRANSPOSE side, const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) {
  const bool transposed = side == CblasTrans;
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(transposed ? A.cols() : A.rows(), B.cols());
  if (A.size() == 0 || B.size() == 0) return result;
  lapack::use_one_thread();
  const auto rows = static_cast<int>(A.rows()), n = static_cast<int>(B.cols());
  if (n > few_columns) {
    const auto m = static_cast<int>(result.rows()), k = static_cast<int>(B.rows());
    cblas_dgemm(CblasColMajor, side, CblasNoTrans, m, n, k, 1.0, A.data(), rows, B.data(), k, 0.0, result.data(), m);
    return result;
  }
  for (Eigen::Index first = 0; first < A.cols(); first += columns_at_once) {
    const auto count = static_cast<int>(std::min(columns_at_once, A.cols() - first));
    for (Eigen::Index j = 0; j < n; ++j) {
      const double* const x = transposed ? B.col(j).data() : &B(first, j);
      double* const y = transposed ? &result(first, j) : result.col(j).data();
      cblas_dgemv(CblasColMajor, side, rows, count, 1.0, A.col(first).data(), rows, x, 1, 1.0, y, 1);
    }
  }
  return result;
}

}  // namespace

Eigen::MatrixXd dense_product(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) { return product(CblasNoTrans, A, B); }

Eigen::MatrixXd transposed_product(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) { return product(CblasTrans, A, B); }

std::size_t DenseRows::bytes() const {
  return static_cast<std::size_t>(values_.size()) * sizeof(double) +
         static_cast<std::size_t>(spread_.nonZeros()) * (sizeof(double) + sizeof(std::int64_t)) +
         static_cast<std::size_t>(spread_.rows() + 1) * sizeof(std::int64_t);
}

std::vector<Vec3> DenseRows::spread_out(const Eigen::MatrixXd& at) const {
  std::vector<Vec3> result(static_cast<std::size_t>(spread_.rows()), Vec3{});
  for (std::size_t i = 0; i < result.size(); ++i) {
    for (SparseRows::InnerIterator it(spread_, static_cast<std::int64_t>(i)); it; ++it) {
      for (std::size_t k = 0; k < 3; ++k) result[i][k] += it.value() * at(it.col(), static_cast<Eigen::Index>(k));
    }
  }
  return result;
}

Eigen::MatrixXd DenseRows::transposed_times(const std::vector<Vec3>& y) const {
  Eigen::MatrixXd at = Eigen::MatrixXd::Zero(values_.rows(), 3);
  for (std::size_t i = 0; i < y.size(); ++i) {
    for (SparseRows::InnerIterator it(spread_, static_cast<std::int64_t>(i)); it; ++it) {
      for (Eigen::Index k = 0; k < 3; ++k) at(it.col(), k) += it.value() * y[i][static_cast<std::size_t>(k)];
    }
  }
  return transposed_product(values_, at);
}

Eigen::MatrixXd DenseRows::product(const SparseMatrix& Q) const {
  const Eigen::MatrixXd right = Q * values_;
  return transposed_product(values_, right);
}

}  // namespace deform
