// SPDX-License-Identifier: GPL-3.0-or-later
// Projections onto subspaces against products of dense matrices.
#include "core/numerics/sampling/subspace.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "core/base/run_context.h"

namespace deform::subspace_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

void expect_lower(const SparseMatrix& lower, const MatrixXd& full) {
  const MatrixXd found = lower, expected = full.triangularView<Eigen::Lower>();
  ASSERT_EQ(found.rows(), expected.rows());
  ASSERT_EQ(found.cols(), expected.cols());
  EXPECT_LT((found - expected).norm(), 1e-13 * full.norm());
}

TEST(ProjectedLower, IsTheLowerTriangleOfTheProduct) {
  // More columns than one thread takes at once.
  const Index n = 211, k = 150;
  MatrixXd E = MatrixXd::Zero(n, n);
  for (Index i = 0; i < n; ++i) {
    E(i, i) = 4 + 0.01 * static_cast<double>(i);
    const Index j = (i * 17 + 5) % n;
    E(i, j) -= 1;
    E(j, i) -= 1;
  }
  MatrixXd phi = MatrixXd::Zero(n, k);
  for (Index j = 0; j < k; ++j) {
    for (Index r = 0; r < 9; ++r) phi((j * 13 + r * 29) % n, j) = std::sin(static_cast<double>(1 + j + 3 * r));
  }
  const MatrixXd expected = phi.transpose() * E * phi;
  const SparseMatrix sparse_E = E.sparseView();
  const SparseRows rows = phi.sparseView();
  for (const int threads : {1, 2}) {
    RunContext context;
    context.threads = threads;
    expect_lower(projected_lower(sparse_E, phi, context), expected);
    expect_lower(projected_lower(sparse_E, rows, context), expected);
  }
}

}  // namespace
}  // namespace deform::subspace_test
