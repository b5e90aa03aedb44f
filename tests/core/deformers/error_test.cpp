// SPDX-License-Identifier: GPL-3.0-or-later
// The error that a report tells, against solutions in extended precision at every point: never less than half of what it is, and
// in the median not 20 times as large.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/linear_algebra.h"
#include "tests/support/long_tests.h"

namespace deform::error_test {
namespace {

using Extended = long double;
using Matrix = Eigen::Matrix<Extended, Eigen::Dynamic, Eigen::Dynamic>;

/// Kernels of table 3.1 of the thesis by their formulas; e is the shape in model units.
Extended phi(Kernel kernel, Extended r, Extended e) {
  const Extended x = r / e;
  switch (kernel) {
    case Kernel::triharmonic:
      return r * r * r;
    case Kernel::biharmonic:
      return r;
    case Kernel::quintic:
      return r * r * r * r * r;
    case Kernel::gaussian:
      return std::exp(-x * x);
    case Kernel::multiquadric:
      return std::sqrt(1 + x * x);
    case Kernel::inverse_multiquadric:
      return 1 / std::sqrt(1 + x * x);
    case Kernel::wendland_c2:
      return x < 1 ? (1 - x) * (1 - x) * (1 - x) * (1 - x) * (4 * x + 1) : 0;
    case Kernel::thin_plate:
      return r > 0 ? r * r * std::log(r) : 0;
  }
  return 0;
}

std::vector<Extended> monomials(const Vec3& x, int degree) {
  const Extended a = x[0], b = x[1], c = x[2];
  std::vector<Extended> all{1, a, b, c};
  if (degree == 2) all.insert(all.end(), {a * a, a * b, a * c, b * b, b * c, c * c});
  return all;
}

struct Case {
  std::shared_ptr<const Mesh> mesh;
  Setup setup;
  Design design;
  std::vector<PointId> centres;
  double size = 1;  ///< diagonal of the centres
};

/// A bumpy sheet with noise, in some unit and at some place; its ends move or stay.
Case random_case(std::uint32_t seed) {
  std::mt19937 random(seed);
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  const auto pick = [&](std::size_t count) { return std::uniform_int_distribution<std::size_t>(0, count - 1)(random); };
  Case result;
  const std::size_t columns = 10 + pick(22), rows = 5 + pick(10);
  Mesh mesh = test::bumpy_sheet(columns, rows);
  for (Vec3& x : mesh.points) {
    for (double& value : x) value += uniform(-0.005, 0.005);
  }
  const double unit = std::pow(10.0, uniform(-3, 3)), away = seed % 4 == 0 ? uniform(0, 20) : 0;
  Box box;
  std::vector<PointId> left, right;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    const double x = mesh.points[i][0];
    Vec3& p = mesh.points[i];
    p = unit * (p + Vec3{away, -away, 0.3 * away});
    if (x < 0.3) left.push_back(static_cast<PointId>(i));
    if (x > 1.7) right.push_back(static_cast<PointId>(i));
    if (x < 0.3 || x > 1.7) {
      result.centres.push_back(static_cast<PointId>(i));
      box.add(p);
    }
  }
  result.size = box.diagonal();
  RbfOptions options;
  options.kernel = all_kernels()[seed % all_kernels().size()].kernel;
  options.shape = properties(*options.kernel).has_shape ? uniform(0.02, 0.4) : 0;
  options.solver = pick(3) == 0 ? Solver::ldlt : Solver::cholesky;
  options.reduction = CentreReduction::off;
  options.basis = pick(2) == 0 ? BasisMode::never : BasisMode::automatic;
  result.setup.method = options;
  result.setup.handles = {{"right", {Region::Ids{right}}}};
  result.setup.fixed = {{Region::Ids{left}}};
  Affine affine = identity_affine;
  for (std::size_t k = 0; k < 12; ++k) affine[k] += k % 4 == 3 ? unit * uniform(-0.3, 0.3) : 0;
  const double angle = uniform(-0.4, 0.4);
  affine[0] = affine[5] = std::cos(angle);
  affine[1] = -std::sin(angle);
  affine[4] = std::sin(angle);
  result.design.motions.push_back({0, affine});
  result.mesh = test::shared(std::move(mesh));
  return result;
}

/// The deformed points by dense LU in extended precision.
Points reference(const Case& c, const Points& delivered) {
  const auto& options = std::get<RbfOptions>(c.setup.method);
  const Kernel kernel = *options.kernel;
  const int degree = properties(kernel).default_degree();
  const Vec3 origin = c.mesh->points[c.centres[0]];
  const Extended e = options.shape * c.size;
  const auto at = [&](PointId id) { return (1 / c.size) * (c.mesh->points[id] - origin); };
  const auto between = [&](PointId a, PointId b) {
    Extended square = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Extended d = (static_cast<Extended>(c.mesh->points[a][k]) - c.mesh->points[b][k]);
      square += d * d;
    }
    // Kernels without a shape in units of the size, so that the columns of the system are alike.
    return properties(kernel).has_shape ? std::sqrt(square) : std::sqrt(square) / c.size;
  };
  const auto m = static_cast<Eigen::Index>(c.centres.size());
  const auto q = static_cast<Eigen::Index>(monomials({}, degree).size());
  Matrix A = Matrix::Zero(m + q, m + q), F = Matrix::Zero(m + q, 3);
  for (Eigen::Index i = 0; i < m; ++i) {
    const PointId id = c.centres[static_cast<std::size_t>(i)];
    for (Eigen::Index j = 0; j < m; ++j) A(i, j) = phi(kernel, between(id, c.centres[static_cast<std::size_t>(j)]), e);
    const auto terms = monomials(at(id), degree);
    for (Eigen::Index t = 0; t < q; ++t) A(i, m + t) = A(m + t, i) = terms[static_cast<std::size_t>(t)];
    for (std::size_t k = 0; k < 3; ++k) {
      F(i, static_cast<Eigen::Index>(k)) = static_cast<Extended>(delivered[id][k]) - c.mesh->points[id][k];
    }
  }
  const Matrix X = test::lu_solution(A, F);
  Points result = delivered;
  for (std::size_t id = 0; id < result.size(); ++id) {
    if (std::binary_search(c.centres.begin(), c.centres.end(), static_cast<PointId>(id))) continue;
    const auto terms = monomials(at(static_cast<PointId>(id)), degree);
    for (Eigen::Index k = 0; k < 3; ++k) {
      Extended sum = c.mesh->points[id][static_cast<std::size_t>(k)];
      for (Eigen::Index j = 0; j < m; ++j) {
        sum += phi(kernel, between(static_cast<PointId>(id), c.centres[static_cast<std::size_t>(j)]), e) * X(j, k);
      }
      for (Eigen::Index t = 0; t < q; ++t) sum += terms[static_cast<std::size_t>(t)] * X(m + t, k);
      result[id][static_cast<std::size_t>(k)] = static_cast<double>(sum);
    }
  }
  return result;
}

TEST(ReportedError, OfDenseInterpolantsBoundsWhatItIs) {
  const std::uint32_t cases = test::long_tests() ? 1000 : 48;
  std::vector<double> ratios;
  for (std::uint32_t seed = 0; seed < cases; ++seed) {
    const Case c = random_case(seed);
    const auto system = prepare(c.mesh, c.setup);
    const auto evaluation = system->bind({&c.design, 1}, EvaluationPath::automatic, {});
    const Points points = system->evaluate(c.design);
    const double error = evaluation->report(0).error, truth = test::distance(points, reference(c, points));
    const auto& options = std::get<RbfOptions>(c.setup.method);
    EXPECT_GE(error, 0.5 * truth) << seed << ' ' << properties(*options.kernel).name << ", condition " << system->info().condition
                                  << ", " << c.centres.size() << " centres";
    EXPECT_TRUE(evaluation->report(0).converged || error > 1e-9 * c.size) << seed;
    ratios.push_back(error / std::max(truth, 1e-300));
  }
  std::nth_element(ratios.begin(), ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2), ratios.end());
  EXPECT_LE(ratios[ratios.size() / 2], 20);
}

TEST(ReportedError, SaysSoWhenAFactorHasNoCorrectDigits) {
  deform::Setup setup = test::sheet_setup();
  RbfOptions options;
  options.kernel = Kernel::gaussian;
  options.shape = 5;  // of the diagonal: flat over all of the sheet, singular to working precision
  options.solver = Solver::ldlt;
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    options.basis = basis;
    setup.method = options;
    Design design;
    design.motions.push_back({0, test::turn_and_shift()});
    const auto system = prepare(test::shared(test::bumpy_sheet(31, 16)), setup);
    const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
    const DesignReport& report = evaluation->report(0);
    EXPECT_GT(system->info().condition, 1e15);
    EXPECT_TRUE(!report.converged || report.error > 1e-3 * report.prescribed_displacement) << report.error;
  }
}

}  // namespace
}  // namespace deform::error_test
