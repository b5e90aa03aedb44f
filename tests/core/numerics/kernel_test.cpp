// SPDX-License-Identifier: GPL-3.0-or-later
// Kernels against their definitions, and the orders and signs they claim against eigenvalues.
#include "core/numerics/kernels/kernel.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>

#include "core/numerics/kernels/polynomial.h"
#include "tests/core/numerics/random_points.h"

namespace deform::kernel_test {
namespace {

TEST(Kernel, ValuesAreThoseOfTheThesis) {
  const double r = 0.7, s = 1.3;
  const auto at = [&](Kernel kernel, double distance) { return value({kernel, s}, distance * distance); };
  EXPECT_DOUBLE_EQ(at(Kernel::triharmonic, r), r * r * r);
  EXPECT_DOUBLE_EQ(at(Kernel::biharmonic, r), r);
  EXPECT_DOUBLE_EQ(at(Kernel::quintic, r), std::pow(r, 5));
  EXPECT_DOUBLE_EQ(at(Kernel::gaussian, r), std::exp(-(r / s) * (r / s)));
  EXPECT_DOUBLE_EQ(at(Kernel::multiquadric, r), std::sqrt(r * r + s * s));
  EXPECT_DOUBLE_EQ(at(Kernel::inverse_multiquadric, r), 1 / std::sqrt(r * r + s * s));
  EXPECT_DOUBLE_EQ(at(Kernel::wendland_c2, r), std::pow(1 - r / s, 4) * (4 * r / s + 1));
  EXPECT_EQ(at(Kernel::wendland_c2, 1.4), 0.0);
  EXPECT_EQ(at(Kernel::wendland_c2, 0), 1.0);
  EXPECT_DOUBLE_EQ(at(Kernel::thin_plate, r), r * r * std::log(r));
  for (const Kernel kernel : {Kernel::triharmonic, Kernel::biharmonic, Kernel::quintic, Kernel::thin_plate})
    EXPECT_EQ(at(kernel, 0), 0.0);
}

// Smallest and largest eigenvalue of sign * phi on the complement of the polynomials of the given degree (-1: everything).
std::pair<double, double> projected_eigenvalues(const RadialKernel& kernel, int degree) {
  const auto points = test::random_points(80, 5);
  const auto m = static_cast<Eigen::Index>(points.size());
  Eigen::MatrixXd A(m, m);
  for (Eigen::Index i = 0; i < m; ++i) {
    for (Eigen::Index j = 0; j < m; ++j) {
      const double r2 = test::squared_distance(points[static_cast<std::size_t>(i)], points[static_cast<std::size_t>(j)]);
      A(i, j) = properties(kernel.kernel).sign * value(kernel, r2);
    }
  }
  const PolynomialSpace polynomials(points, degree);
  const auto q = static_cast<Eigen::Index>(polynomials.terms());
  Eigen::MatrixXd rest = Eigen::MatrixXd::Identity(m, m);
  if (q > 0) {
    const Eigen::MatrixXd Q = Eigen::HouseholderQR<Eigen::MatrixXd>(polynomials.matrix(points)).householderQ();
    rest = Q.rightCols(m - q);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(rest.transpose() * A * rest);
  return {eigen.eigenvalues().minCoeff(), eigen.eigenvalues().maxCoeff()};
}

TEST(Kernel, OrderAndSignMakeThemPositiveDefinite) {
  for (const RadialKernel& kernel : test::all_kernels()) {
    const KernelProperties claims = properties(kernel.kernel);
    const auto [smallest, largest] = projected_eigenvalues(kernel, claims.order - 1);
    EXPECT_GT(smallest, 1e-14 * largest) << claims.name;
    if (claims.order == 0) continue;
    EXPECT_LT(projected_eigenvalues(kernel, claims.order - 2).first, 0) << claims.name << " has a smaller order than claimed";
  }
}

TEST(Kernel, EveryOneIsTestedAndFoundByItsName) {
  const auto tested = test::all_kernels();
  ASSERT_EQ(tested.size(), all_kernels().size());
  for (std::size_t i = 0; i < tested.size(); ++i) {
    EXPECT_EQ(all_kernels()[i].kernel, tested[i].kernel);
    EXPECT_EQ(properties(tested[i].kernel).kernel, tested[i].kernel);
    EXPECT_EQ(kernel_named(all_kernels()[i].name), tested[i].kernel);
  }
  EXPECT_EQ(kernel_named("Gaussian"), std::nullopt);
  EXPECT_EQ(kernel_named(""), std::nullopt);
}

// What the functions of a subspace are cut off at is next to nothing (thesis 8.3.2).
TEST(Kernel, LocalOnesHaveDecayedAtTheirReach) {
  for (const KernelProperties& kernel : all_kernels()) {
    if (kernel.local_shape == 0) continue;
    EXPECT_EQ(value({kernel.kernel, kernel.local_shape}, 0), 1) << kernel.name;
    EXPECT_LT(value({kernel.kernel, kernel.local_shape}, 1), 2e-4) << kernel.name;
  }
}

TEST(Kernel, AutomaticShapeFollowsTheSpacingUpToHalfTheDiagonal) {
  EXPECT_DOUBLE_EQ(automatic_shape(Kernel::gaussian, 0.01, 2), 0.02);
  EXPECT_DOUBLE_EQ(automatic_shape(Kernel::multiquadric, 0.01, 2), 0.03);
  EXPECT_DOUBLE_EQ(automatic_shape(Kernel::inverse_multiquadric, 0.9, 2), 1);
  EXPECT_DOUBLE_EQ(automatic_shape(Kernel::wendland_c2, 0.01, 2), 1);
}

}  // namespace
}  // namespace deform::kernel_test
