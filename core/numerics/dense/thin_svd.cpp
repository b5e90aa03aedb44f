// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/dense/thin_svd.h"

#include <algorithm>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/numerics/dense/lapack.h"

namespace deform {

ThinSvd thin_svd(Eigen::MatrixXd A) {
  lapack::use_one_thread();
  const int m = static_cast<int>(A.rows()), n = static_cast<int>(A.cols()), k = std::min(m, n);
  ThinSvd svd{Eigen::MatrixXd(m, k), Eigen::VectorXd(k), {}};
  if (k == 0) {
    svd.V.resize(n, 0);
    return svd;
  }
  if (!A.allFinite()) throw Error(ErrorCode::numerical_failure, "a matrix that is not finite has no singular values");
  Eigen::MatrixXd transposed(k, n);
  std::vector<int> integers(8 * static_cast<std::size_t>(k));
  double wanted = 0;
  int info = 0, length = -1;
  const auto call = [&](double* work) {
    dgesdd_("S", &m, &n, A.data(), &m, svd.values.data(), svd.U.data(), &m, transposed.data(), &k, work, &length, integers.data(),
            &info);
  };
  call(&wanted);
  length = static_cast<int>(wanted);
  std::vector<double> work(static_cast<std::size_t>(length));
  call(work.data());
  if (info != 0) {
    throw Error(ErrorCode::numerical_failure,
                "the singular values of a matrix of " + std::to_string(m) + " x " + std::to_string(n) + " did not converge");
  }
  svd.V = transposed.transpose();
  return svd;
}

std::size_t thin_svd_bytes(std::size_t rows, std::size_t columns) {
  const std::size_t k = std::min(rows, columns), more = std::max(rows, columns);
  // A, U, V^T and V; the documented work space with blocks of 64.
  const std::size_t work = 5 * k * k + 64 * (more + 3 * k) + 7 * k;
  return sizeof(double) * (rows * columns + rows * k + 2 * columns * k + k + work) + 8 * k * sizeof(int);
}

}  // namespace deform
