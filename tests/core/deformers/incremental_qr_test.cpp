// SPDX-License-Identifier: GPL-3.0-or-later
// The RBF system solved by incremental QR: what holds for the other solvers holds to its tolerance, with fewer centres.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/base/error.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/mirrored.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/expect_error.h"

namespace deform::incremental_qr_test {
namespace {

constexpr double tolerance = 1e-4;

Setup incremental_setup(BasisMode basis) {
  deform::Setup setup = test::sheet_setup();
  RbfOptions options;
  options.solver = Solver::incremental_qr;
  options.tolerance = tolerance;
  options.reduction = CentreReduction::off;
  options.basis = basis;
  setup.method = options;
  setup.variables.push_back({"up", "end", DesignVariable::Translate{{0, 0, 1}}});
  setup.variables.push_back({"turn", "end", DesignVariable::Rotate{{0, 0, 1}, {2, 0.5, 0}}});
  return setup;
}

struct Prepared {
  std::shared_ptr<const Mesh> mesh = test::shared(test::bumpy_sheet(100, 51));
  double diagonal = bounding_box(mesh->points).diagonal();
  std::shared_ptr<const System> system(BasisMode basis) const { return prepare(mesh, incremental_setup(basis)); }
};

TEST(IncrementalQrSystem, BothPathsAgreeWithCholesky) {
  const Prepared prepared;
  deform::Setup exact = incremental_setup(BasisMode::always);
  std::get<RbfOptions>(exact.method).solver = Solver::cholesky;
  const auto reference = prepare(prepared.mesh, exact);
  const Design design{{0.2, 0.3}, {}};
  const Points expected = reference->evaluate(design);
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    const auto system = prepared.system(basis);
    EXPECT_EQ(system->info().solver, Solver::incremental_qr);
    EXPECT_EQ(system->info().tolerance, tolerance);
    EXPECT_GT(system->info().constraint_points, 1000u);
    EXPECT_LT(5 * system->info().centres, system->info().constraint_points);
    EXPECT_LT(2 * system->info().factor_bytes, reference->info().factor_bytes);
    const Estimate expense = estimate(*prepared.mesh, incremental_setup(basis));
    EXPECT_LE(system->info().factor_bytes, expense.factor_bytes);
    EXPECT_LE(system->bytes(), expense.peak_bytes);
    ASSERT_FALSE(system->info().notes.empty());
    // The deformable points lie in a gap two thirds as wide as the sheet, where small errors at its ends grow.
    EXPECT_LE(test::distance(system->evaluate(design), expected), 60 * tolerance * prepared.diagonal);
    const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
    EXPECT_LE(evaluation->report(0).interpolation_residual, 20 * tolerance * prepared.diagonal);
    EXPECT_GT(evaluation->report(0).interpolation_residual, 0);
  }
}

TEST(IncrementalQrSystem, ConstraintPointsAreExact) {
  const Prepared prepared;
  const auto system = prepared.system(BasisMode::never);
  const Design design{{0.2, 0}, {}};
  const Points points = system->evaluate(design);
  const SelectedRegions regions = validate(incremental_setup(BasisMode::never), *prepared.mesh);
  for (const PointId id : regions.fixed) EXPECT_EQ(points[id], prepared.mesh->points[id]);
  for (const PointId id : regions.handles[0]) EXPECT_NEAR(points[id][2], prepared.mesh->points[id][2] + 0.2, 1e-15);
}

// With motions that differ from point to point, which the centres were not chosen for; also on ranges and in populations.
TEST(IncrementalQrSystem, DisplacementsPerPoint) {
  const Prepared prepared;
  const auto system = prepared.system(BasisMode::always);
  const SelectedRegions regions = validate(incremental_setup(BasisMode::always), *prepared.mesh);
  std::vector<Vec3> bump;
  for (const PointId id : regions.handles[0]) bump.push_back({0, 0, 0.1 * std::sin(3 * prepared.mesh->points[id][1])});
  Design free;
  free.motions.push_back({0, bump});
  const std::vector<Design> designs{Design{{0.1, 0}, {}}, free, Design{{0, 0.2}, {}}, free};
  const std::vector<Points> together = system->evaluate(designs);
  for (std::size_t i = 0; i < designs.size(); ++i) EXPECT_EQ(test::distance(together[i], system->evaluate(designs[i])), 0) << i;
  const auto evaluation = system->bind(designs, EvaluationPath::automatic, {});
  EXPECT_LE(evaluation->report(1).interpolation_residual, 50 * tolerance * prepared.diagonal);
}

TEST(IncrementalQrSystem, JacobianProductsAreAdjoint) {
  const Prepared prepared;
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  Points cotangent(prepared.mesh->point_count());
  for (Vec3& v : cotangent) {
    for (double& x : v) x = normal(random);
  }
  const std::vector<double> at{0.1, 0.2}, direction{0.7, -0.4};
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    const auto system = prepared.system(basis);
    const Points product = system->jacobian_vector(at, direction, {});
    const std::vector<double> gradient = system->vector_jacobian(at, cotangent, {});
    double left = 0, size = 0;
    for (std::size_t i = 0; i < product.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        left += cotangent[i][k] * product[i][k];
        size += std::abs(cotangent[i][k] * product[i][k]);
      }
    }
    // Both take all centres, whatever the tolerance.
    EXPECT_NEAR(left, direction[0] * gradient[0] + direction[1] * gradient[1],
                (basis == BasisMode::always ? 1e-12 : 1e-9) * size);
  }
}

TEST(IncrementalQrSystem, RefusesWhatDoesNotFit) {
  const Prepared prepared;
  const std::size_t needed = estimate(*prepared.mesh, incremental_setup(BasisMode::never)).peak_bytes;
  test::expect_error(ErrorCode::out_of_budget, {},
                     [&] { prepare(prepared.mesh, incremental_setup(BasisMode::never), {}, needed / 2); });
  EXPECT_NO_THROW(prepare(prepared.mesh, incremental_setup(BasisMode::never), {}, needed));
}

TEST(IncrementalQrSystem, ADesignMayAskForLess) {
  const Prepared prepared;
  const auto system = prepared.system(BasisMode::always);
  Design design{{0.2, 0.3}, {}};
  const Points fine = system->evaluate(design);
  design.tolerance = tolerance;
  EXPECT_EQ(test::distance(system->evaluate(design), fine), 0);  // the basis is that of the setup
  design.tolerance = 1e-2;
  const auto coarse = system->bind({&design, 1}, EvaluationPath::automatic, {});
  EXPECT_EQ(coarse->report(0).path, EvaluationPath::direct);
  EXPECT_GT(coarse->report(0).interpolation_residual, 2 * tolerance * prepared.diagonal);
  EXPECT_LE(coarse->report(0).interpolation_residual, 20 * 1e-2 * prepared.diagonal);
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "path BASIS"}, [&] {
    system->bind({&design, 1}, EvaluationPath::basis, {});
  });
  for (const double bad : {1e-5, 2e-2, -1.0, std::nan("")}) {
    design.tolerance = bad;
    test::expect_error(ErrorCode::invalid_argument, {"designs[0].tolerance", "0.0001..0.01"}, [&] { system->evaluate(design); });
  }
  deform::Setup exact = incremental_setup(BasisMode::never);
  std::get<RbfOptions>(exact.method).solver = Solver::cholesky;
  design.tolerance = 1e-3;
  test::expect_error(ErrorCode::invalid_argument, {"designs[0].tolerance", "cholesky"},
                     [&] { prepare(prepared.mesh, exact)->evaluate(design); });
}

// A small handle amid a sheet that stays: evenly spread centres find it late.
TEST(IncrementalQrSystem, GreedyCentresFollowTheSamples) {
  const auto mesh = test::shared(test::bumpy_sheet(81, 41));
  const Region middle = test::box({0.9, 0.4, -1}, {1.1, 0.6, 1}), around = test::box({0.7, 0.2, -1}, {1.3, 0.8, 1});
  deform::Setup setup;
  setup.handles = {{"middle", middle}};
  setup.fixed = {{Region::Complement{{around}}}};
  setup.variables = {{"up", "middle", DesignVariable::Translate{{0, 0, 1}}}};
  RbfOptions options;
  options.solver = Solver::incremental_qr;
  options.tolerance = 1e-4;
  options.samples = {{0.1}};
  options.reduction = CentreReduction::off;
  std::size_t centres[2];
  for (const CentreOrder order : {CentreOrder::farthest_point, CentreOrder::greedy}) {
    options.centre_order = order;
    setup.method = options;
    const auto system = prepare(mesh, setup);
    centres[order == CentreOrder::greedy ? 1 : 0] = system->info().centres;
    const Design design{{0.1}, {}};
    const auto evaluation = system->bind({&design, 1}, EvaluationPath::direct, {});
    EXPECT_GT(evaluation->report(0).interpolation_residual, 0);
    EXPECT_LE(evaluation->report(0).interpolation_residual, 50 * options.tolerance * system->info().diagonal);
  }
  EXPECT_LT(3 * centres[1], 2 * centres[0]);
}

TEST(IncrementalQrSystem, HalfModels) {
  for (std::size_t planes = 1; planes <= 3; ++planes) {
    test::HalfModel half(planes, test::oblique());
    const Points exact = prepare(half.half, half.setup)->evaluate(half.design());
    auto& options = std::get<RbfOptions>(half.setup.method);
    options.solver = Solver::incremental_qr;
    options.tolerance = 1e-9;
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      options.basis = basis;
      const auto system = prepare(half.half, half.setup);
      EXPECT_EQ(system->info().solver, Solver::incremental_qr);
      const Points got = system->evaluate(half.design());
      EXPECT_LT(test::distance(got, exact), 1e-7 * system->info().diagonal) << planes;
      EXPECT_LE(half.out_of_planes(got), 1e-15 * system->info().diagonal);
    }
  }
}

TEST(IncrementalQrSystem, SamplesAreChecked) {
  const Prepared prepared;
  deform::Setup setup = incremental_setup(BasisMode::never);
  const auto refused = [&](std::vector<std::vector<double>> samples, const std::vector<const char*>& parts) {
    std::get<RbfOptions>(setup.method).samples = std::move(samples);
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { prepare(prepared.mesh, setup); });
  };
  refused({{0.1, 0}, {0.1}}, {"method.rbf.samples[1].variables"});
  refused({{0, 0}}, {"method.rbf.samples[0]", "all its variables are 0"});
  refused({{std::nan(""), 0}}, {"method.rbf.samples[0].variables[0]", "finite"});
}

}  // namespace
}  // namespace deform::incremental_qr_test
