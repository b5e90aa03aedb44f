// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/bordered_lu.h"

#include "core/numerics/dense/lapack.h"
#include "core/numerics/kernels/kernel_rows.h"
#include "core/numerics/kernels/polynomial.h"

extern "C" {
void dgetrf_(const int* m, const int* n, double* a, const int* lda, int* ipiv, int* info);
void dgetrs_(const char* trans, const int* n, const int* nrhs, const double* a, const int* lda, const int* ipiv, double* b,
             const int* ldb, int* info);
}

namespace deform::bench {

BorderedLu::BorderedLu(std::span<const Vec3> centres) {
  lapack::use_one_thread();
  const Eigen::MatrixXd P = PolynomialSpace(centres, 1).matrix(centres);
  const Eigen::Index m = P.rows(), q = P.cols();
  A_ = Eigen::MatrixXd::Zero(m + q, m + q);
  A_.topLeftCorner(m, m) = full_kernel_rows({}, centres, centres);
  A_.topRightCorner(m, q) = P;
  A_.bottomLeftCorner(q, m) = P.transpose();
  const int n = static_cast<int>(m + q);
  pivots_.resize(static_cast<std::size_t>(n));
  int info = 0;
  dgetrf_(&n, &n, A_.data(), &n, pivots_.data(), &info);
}

Eigen::MatrixXd BorderedLu::solve(const Eigen::MatrixXd& F) const {
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(A_.rows(), F.cols());
  B.topRows(F.rows()) = F;
  const int n = static_cast<int>(A_.rows()), columns = static_cast<int>(B.cols());
  int info = 0;
  dgetrs_("N", &n, &columns, A_.data(), &n, pivots_.data(), B.data(), &n, &info);
  return B;
}

}  // namespace deform::bench
