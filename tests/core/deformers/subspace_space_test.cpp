// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/subspace.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <limits>
#include <string>

#include "core/mesh/operators/shell_operators.h"
#include "core/numerics/kernels/kernel_rows.h"
#include "core/numerics/sampling/subspace.h"
#include "tests/core/deformers/space_cases.h"
#include "tests/core/numerics/random_points.h"
#include "tests/support/expect_error.h"
#include "tests/support/thesis_options.h"

namespace deform::subspace_space_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr std::optional<Kernel> every_kind[] = {Kernel::triharmonic, Kernel::biharmonic, Kernel::wendland_c2, Kernel::gaussian,
                                                std::nullopt};

SubspaceOptions options(std::optional<Kernel> kernel, double stretching = 1, double bending = 0.5, std::size_t centres = 80) {
  SubspaceOptions chosen = test::thesis_subspace();
  chosen.kernel = kernel;
  chosen.centres = centres;
  chosen.stretching = stretching;
  chosen.bending = bending;
  return chosen;
}

class Subspaces : public testing::TestWithParam<std::optional<Kernel>> {
 protected:
  const Mesh plane_ = test::flat_grid(20, 15, 2, 1);
};

TEST_P(Subspaces, EnergyIsThatOfTheShellForEveryFunction) {
  const EnergySpace space = shell_subspace(plane_, options(GetParam()), 3);
  const ShellOperators shell = shell_operators(plane_, bounding_box(plane_.points).diagonal());
  const MatrixXd L(shell.laplacian), phi(space.values), K = SparseMatrix(space.energy.selfadjointView<Eigen::Lower>());
  const MatrixXd E = -L + 0.5 * L * shell.areas.cwiseInverse().asDiagonal() * L;
  EXPECT_LT((phi.transpose() * E * phi - K).norm(), 1e-12 * K.norm());
  EXPECT_EQ(space.samples, static_cast<std::size_t>(phi.cols()));
  EXPECT_EQ(space.samples, 80u);
  EXPECT_EQ(space.linear.rows(), space.values.cols());
  EXPECT_EQ(space.linear.cols(), GetParam() ? 0 : 4);
}

TEST_P(Subspaces, SameForAnyNumberOfThreads) {
  RunContext one, two;
  one.threads = 1;
  two.threads = 2;
  const EnergySpace a = shell_subspace(plane_, options(GetParam()), 3, one),
                    b = shell_subspace(plane_, options(GetParam()), 3, two);
  ASSERT_EQ(a.values.nonZeros(), b.values.nonZeros());
  EXPECT_TRUE(std::equal(a.values.valuePtr(), a.values.valuePtr() + a.values.nonZeros(), b.values.valuePtr()));
  ASSERT_EQ(a.energy.nonZeros(), b.energy.nonZeros());
  EXPECT_TRUE(std::equal(a.energy.valuePtr(), a.energy.valuePtr() + a.energy.nonZeros(), b.energy.valuePtr()));
}

TEST_P(Subspaces, EstimateIsAnUpperBound) {
  const auto chosen = options(GetParam(), 1, 1, 200);
  const EnergySpace space = shell_subspace(plane_, chosen, 3);
  const SpaceBytes bytes = estimate_shell_subspace(plane_, chosen);
  EXPECT_GE(bytes.resident, 16 * static_cast<std::size_t>(space.values.nonZeros() + space.energy.nonZeros()));
  EXPECT_GE(bytes.energy_entries, static_cast<std::size_t>(space.energy.nonZeros()));
  EXPECT_GT(bytes.peak, bytes.resident);
}

TEST_P(Subspaces, MoreCentresThanPoints) {
  const Mesh small = test::flat_grid(4, 3, 2, 1);
  const EnergySpace space = shell_subspace(small, options(GetParam(), 1, 0, 1000), 3);
  EXPECT_LE(space.values.cols(), 12);
  EXPECT_GE(space.values.cols(), 4);
  EXPECT_TRUE(MatrixXd(space.values).allFinite());
}

TEST_P(Subspaces, Cancelled) {
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  test::expect_error(ErrorCode::cancelled, {}, [&] { shell_subspace(plane_, options(GetParam()), 1, context); });
}

INSTANTIATE_TEST_SUITE_P(All, Subspaces, testing::ValuesIn(every_kind));

TEST(OrthonormalColumns, SpanTheSameAndEndWhereColumnsDepend) {
  const auto points = test::random_points(300, 1), centres = test::random_points(100, 2);
  MatrixXd phi = full_kernel_rows({Kernel::biharmonic, 1}, centres, points);
  const MatrixXd Q = orthonormal_columns(phi);
  ASSERT_EQ(Q.cols(), 100);
  EXPECT_LT((Q.transpose() * Q - MatrixXd::Identity(100, 100)).norm(), 1e-12);
  EXPECT_LT((phi - Q * (Q.transpose() * phi)).norm(), 1e-12 * phi.norm());
  phi.col(70) = phi.col(3) - 2 * phi.col(5);
  EXPECT_EQ(orthonormal_columns(phi).cols(), 70);
}

TEST(KernelRows, AreTheKernelWithinTheReach) {
  const auto points = test::random_points(200, 1), centres = test::random_points(50, 2);
  const RadialKernel wendland{Kernel::wendland_c2, 0.4};
  const SparseRows rows = kernel_rows(wendland, 0.4, centres, points);
  const MatrixXd full = full_kernel_rows(wendland, centres, points);
  EXPECT_LT(rows.nonZeros(), full.size() / 3);
  EXPECT_EQ((MatrixXd(rows) - full).cwiseAbs().maxCoeff(), 0);
  EXPECT_DOUBLE_EQ(full(3, 4), value(wendland, test::squared_distance(points[3], centres[4])));
}

}  // namespace
}  // namespace deform::subspace_space_test
