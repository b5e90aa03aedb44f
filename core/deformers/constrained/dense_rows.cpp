// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/dense_rows.h"

#include "core/numerics/dense/lapack.h"

namespace deform {

Eigen::MatrixXd transposed_product(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(A.cols(), B.cols());
  if (A.rows() == 0 || result.size() == 0) return result;
  lapack::use_one_thread();
  const auto m = static_cast<int>(A.cols()), n = static_cast<int>(B.cols()), k = static_cast<int>(A.rows());
  cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, m, n, k, 1.0, A.data(), k, B.data(), k, 0.0, result.data(), m);
  return result;
}

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
