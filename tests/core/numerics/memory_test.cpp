// SPDX-License-Identifier: GPL-3.0-or-later
// What is said of memory against what is allocated: budgets and caches go by it.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "core/numerics/dense/blocked_qr.h"
#include "core/numerics/fast_sums/fast_sums.h"
#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/interpolation/point_errors.h"
#include "core/numerics/sparse/sparse_cholesky.h"
#include "tests/core/numerics/random_points.h"
#include "tests/support/counted_allocations.h"

namespace deform::memory_test {
namespace {

using test::CountedAllocations;
using test::random_points;

constexpr double few_bytes = 45'000;  // of small vectors and names

RunContext one_thread() {
  RunContext context;
  context.threads = 1;
  return context;
}

/// About evenly on the unit sphere.
std::vector<Vec3> sphere(std::size_t count) {
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < count; ++i) {
    const double z = 1 - 2 * (static_cast<double>(i) + 0.5) / static_cast<double>(count), r = std::sqrt(1 - z * z);
    points.push_back({r * std::cos(2.4 * static_cast<double>(i)), r * std::sin(2.4 * static_cast<double>(i)), z});
  }
  return points;
}

/// `told` is `taken`, or a bound of it that is at most so many times as much.
void expect_bytes(const char* what, std::size_t told, std::size_t taken, double most = 1.02) {
  EXPECT_GE(static_cast<double>(told), 0.98 * static_cast<double>(taken) - few_bytes) << what;
  EXPECT_LE(static_cast<double>(told), most * static_cast<double>(taken) + few_bytes) << what;
}

TEST(Memory, OfInterpolators) {
  for (const Solver solver : {Solver::cholesky, Solver::ldlt, Solver::iterative, Solver::incremental_qr}) {
    constexpr std::size_t m = 700;
    SCOPED_TRACE(to_string(solver));
    InterpolationOptions options;
    options.solver = solver;
    const auto centres = sphere(m);
    make_interpolator(centres, options, one_thread());
    const CountedAllocations counted;
    const auto system = make_interpolator(centres, options, one_thread());
    expect_bytes("bytes", system->bytes(), counted.kept());
    expect_bytes("interpolator_bytes", interpolator_bytes(m, solver) + m * sizeof(Vec3), counted.kept(), 1.35);
    const Eigen::MatrixXd values = Eigen::MatrixXd::Random(static_cast<Eigen::Index>(m), 3);
    system->interpolate(values, 1e-6, one_thread());
    expect_bytes("interpolator_peak_bytes", interpolator_peak_bytes(m, solver), counted.most(), 2);
  }
}

TEST(Memory, OfPointErrors) {
  for (const Solver solver : {Solver::cholesky, Solver::iterative}) {
    for (const std::size_t dense : {std::size_t{3000}, std::size_t{100}}) {
      SCOPED_TRACE(std::string(to_string(solver)) + " dense " + std::to_string(dense));
      constexpr std::size_t m = 700;
      InterpolationOptions options;
      options.solver = solver;
      const auto system = make_interpolator(sphere(m), options, one_thread());
      const Eigen::MatrixXd values = Eigen::MatrixXd::Random(m, 3);
      const Interpolants interpolants = system->interpolate(values, 1e-6, one_thread());
      const auto places = random_points(300, 5), points = random_points(20000, 6);
      const CountedAllocations counted;
      const PointErrors errors(*system, options.polynomial_degree, places, one_thread(), dense);
      expect_bytes("bytes", errors.bytes(), counted.kept());
      const auto missing = errors.missing(*system, interpolants, values, one_thread());
      if (dense > m) {
        expect_bytes("bytes_for", PointErrors::bytes_for(m, options.kernel, solver), counted.kept(), 1.15);
        expect_bytes("peak_bytes", PointErrors::peak_bytes(m, options.kernel, solver), counted.most(), 3.3);
      }
      const Eigen::MatrixXd at = errors.errors(missing, one_thread());
      const CountedAllocations largest;
      errors.largest(missing, at, points, one_thread());
      expect_bytes("largest_bytes", PointErrors::largest_bytes(points.size(), m, options.kernel), largest.most(), 1.5);
    }
  }
}

TEST(Memory, OfFastSums) {
  for (const int order : {6, 10}) {
    const auto points = sphere(6000), centres = sphere(4000);
    FastSums::Options options;
    options.order = order;
    const std::vector<double> weights = test::random_values(4000, 3);
    FastSums({Kernel::triharmonic, 1}, points, centres, options).sums(weights, 1, one_thread());
    const CountedAllocations counted;
    const FastSums sums({Kernel::triharmonic, 1}, points, centres, options);
    expect_bytes("bytes", sums.bytes(), counted.kept());
    sums.sums(weights, 1, one_thread());
    EXPECT_GE(FastSums::bytes_for(6000, 4000, order), counted.most());
  }
}

TEST(Memory, OfFactors) {
  SparseMatrix lower(3600, 3600);
  std::vector<Eigen::Triplet<double, std::int64_t>> entries;
  for (std::int64_t i = 0; i < 3600; ++i) {
    entries.emplace_back(i, i, 4.01);
    if (i % 60 != 59) entries.emplace_back(i + 1, i, -1);
    if (i + 60 < 3600) entries.emplace_back(i + 60, i, -1);
  }
  lower.setFromTriplets(entries.begin(), entries.end());
  { const SparseCholesky first(lower, one_thread()); }
  const SparseCholesky::Estimate told = SparseCholesky::estimate(lower);
  {
    const CountedAllocations counted;
    const SparseCholesky factor(lower, one_thread());
    expect_bytes("bytes", factor.bytes(), counted.kept());
    expect_bytes("factor_bytes", told.factor_bytes, counted.kept(), 1.1);
    expect_bytes("peak_bytes", told.peak_bytes, counted.most(), 1.3);
  }
  const Eigen::MatrixXd columns = Eigen::MatrixXd::Random(800, 300);
  const CountedAllocations counted;
  BlockedQr qr(800);
  for (std::size_t first = 0; first < 300; first += 100) {
    qr.append(
        100, [&](double* to) { std::copy_n(columns.data() + first * 800, 100 * 800, to); }, one_thread());
  }
  expect_bytes("qr", qr.bytes(), counted.kept());
  expect_bytes("qr for", BlockedQr::bytes_for(800, 300, 100), counted.kept());
}

}  // namespace
}  // namespace deform::memory_test
