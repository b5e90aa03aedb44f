// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>

#include "core/deformers/energy/energy_system.h"
#include "core/deformers/energy/spaces/shell.h"
#include "core/deformers/handles/constraint_points.h"
#include "core/mesh/operators/shell_operators.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/support/expect_error.h"

namespace deform::shell_test {
namespace {

using test::distance;
using test::shared;

deform::Setup shell(deform::Setup setup, const ShellOptions& options = {}) {
  setup.method = options;
  return setup;
}

const Design turned{{}, {{0, test::turn_and_shift()}}};

TEST(Shell, RestGivesTheSamePoints) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  const auto system = prepare(mesh, shell(test::sheet_setup()));
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const Design rest;
    EXPECT_TRUE(system->evaluate({&rest, 1}, path)[0] == mesh->points);
  }
}

TEST(Shell, UnitsDoNotMatter) {
  const Mesh mesh = test::bumpy_sheet(21, 11);
  Mesh large = mesh;
  deform::Setup setup = test::sheet_setup(), large_setup = setup;
  for (Vec3& x : large.points) x = {1000 * x[0] + 5e4, 1000 * x[1], 1000 * x[2]};
  large_setup.handles[0].region = test::box({51700, -1000, -1000}, {53000, 2000, 1000});
  large_setup.fixed[0] = test::box({49000, -1000, -1000}, {50300, 2000, 1000});
  ShellOptions options;
  options.stretching = 3;
  Affine lift = identity_affine;
  lift[11] = 0.3;
  const Points small_result = prepare(shared(mesh), shell(setup, options))->evaluate({{}, {{0, lift}}});
  lift[11] = 300;
  const Points large_result = prepare(shared(large), shell(large_setup, options))->evaluate({{}, {{0, lift}}});
  for (std::size_t i = 0; i < small_result.size(); ++i) {
    EXPECT_NEAR(large_result[i][2], 1000 * small_result[i][2], 1e-6);
  }
}

// Weights of the cotangents reproduce linear functions on any plane triangulation.
TEST(Shell, StretchingAloneFollowsAffineMotionsInThePlane) {
  Mesh mesh;
  std::vector<PointId> rim;
  constexpr PointId n = 9;
  for (PointId j = 0; j <= n; ++j) {
    for (PointId i = 0; i <= n; ++i) {
      const bool inside = i > 0 && j > 0 && i < n && j < n;
      if (!inside) rim.push_back(static_cast<PointId>(mesh.points.size()));
      mesh.points.push_back(
          {i + (inside ? 0.2 * std::sin(5.0 * i + 3 * j) : 0), 0.6 * j + (inside ? 0.1 * std::cos(2.0 * i + j) : 0), 0});
    }
  }
  for (PointId j = 0; j < n; ++j) {
    for (PointId i = 0; i < n; ++i) {
      const PointId a = j * (n + 1) + i;
      mesh.face_sizes.insert(mesh.face_sizes.end(), {3, 3});
      mesh.face_points.insert(mesh.face_points.end(), {a, a + 1, a + n + 2, a, a + n + 2, a + n + 1});
    }
  }
  deform::Setup setup;
  setup.handles = {{"rim", {Region::Ids{rim}}}};
  const Affine motion{1.5, 0.2, 0, 0.3, -0.4, 0.8, 0, -1, 0.1, -0.2, 1, 0.5};
  ShellOptions options;
  options.stretching = 2;
  options.bending = 0;
  const Points got = prepare(shared(mesh), shell(setup, options))->evaluate({{}, {{0, motion}}});
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(got[i], transformed(motion, mesh.points[i])), 1e-9) << i;
}

TEST(Shell, DisplacementsPerPointAreSolvedFor) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  const auto system = prepare(mesh, shell(test::sheet_setup()));
  const SelectedRegions regions = validate(test::sheet_setup(), *mesh);
  std::vector<Vec3> displacements;
  for (const PointId id : regions.handles[0]) {
    const Vec3 &x = mesh->points[id], y = transformed(test::turn_and_shift(), x);
    displacements.push_back({y[0] - x[0], y[1] - x[1], y[2] - x[2]});
  }
  const Design design{{}, {{0, displacements}}};
  EXPECT_LT(distance(system->evaluate(design), system->evaluate(turned)), 1e-11);
  EXPECT_EQ(system->bind({&design, 1}, EvaluationPath::automatic, {})->report(0).path, EvaluationPath::direct);
}

TEST(Shell, PopulationsEqualSingles) {
  test::check_population(*prepare(shared(test::bumpy_sheet(41, 21)), shell(test::setup_with_variables())), 18);
}

TEST(Shell, JacobianProducts) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  for (const HandleMode handles : {HandleMode::hard, HandleMode::soft}) {
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      ShellOptions options;
      options.handles = handles;
      options.basis = basis;
      test::check_jacobians(*prepare(mesh, shell(test::setup_with_variables(), options)), 1e-11, 1e-6);
    }
  }
}

TEST(Shell, InfoSaysWhatWasDone) {
  const auto mesh = shared(test::bumpy_sheet(81, 41));
  const auto system = prepare(mesh, shell(test::sheet_setup()));
  const SystemInfo& info = system->info();
  EXPECT_EQ(info.solver, Solver::cholesky);
  EXPECT_EQ(info.points, 81u * 41);
  EXPECT_EQ(info.functions, info.deformable_points);
  EXPECT_EQ(info.deformable_points + info.constraint_points, info.points);
  EXPECT_TRUE(info.reduced);
  EXPECT_LE(info.held_points, 2u * 2 * 41);
  EXPECT_EQ(info.basis_fields, 4u);
  EXPECT_GT(info.condition, 10);
  EXPECT_LT(info.condition, 1e12);
  const Estimate expected = estimate(*mesh, shell(test::sheet_setup()));
  EXPECT_EQ(expected.held_points, info.held_points);
  EXPECT_GE(expected.resident_bytes, info.bytes * 95 / 100);
  EXPECT_LE(expected.resident_bytes, info.bytes * 3 / 2);
  EXPECT_GE(expected.peak_bytes, expected.resident_bytes);
}

TEST(Shell, MemoryIsComparedBeforeFactoring) {
  const auto mesh = shared(test::bumpy_sheet(81, 41));
  test::expect_error(ErrorCode::out_of_budget, {"preparing needs", "available"},
                     [&] { prepare(mesh, shell(test::sheet_setup()), {}, 100000); });
  EXPECT_NO_THROW(prepare(mesh, shell(test::sheet_setup()), {}, estimate(*mesh, shell(test::sheet_setup())).peak_bytes));
}

TEST(Shell, WhatNothingHoldsIsRefused) {
  Mesh loose = test::bumpy_sheet(21, 11);
  loose.points.push_back({1, 0.5, 3});
  deform::Setup setup = shell(test::sheet_setup());
  test::expect_error(ErrorCode::invalid_argument, {"no face holds 1", "point 231", "fix"},
                     [&] { prepare(shared(loose), setup); });
  setup.fixed.push_back({Region::Ids{{231}}});
  const Points got = prepare(shared(loose), setup)->evaluate(turned);
  EXPECT_EQ(got[231], loose.points[231]);

  Mesh island = test::bumpy_sheet(21, 11);
  for (const double x : {1.0, 1.1, 1.05}) island.points.push_back({x, x * x, 3});
  island.face_sizes.push_back(3);
  island.face_points.insert(island.face_points.end(), {231, 232, 233});
  for (const HandleMode handles : {HandleMode::hard, HandleMode::soft}) {
    ShellOptions options;
    options.handles = handles;
    deform::Setup floating = shell(test::sheet_setup(), options);
    test::expect_error(ErrorCode::invalid_argument, {"nothing holds", "3 points", "point 231"},
                       [&] { prepare(shared(island), floating); });
    floating.fixed.push_back({Region::Ids{{232}}});
    EXPECT_NO_THROW(prepare(shared(island), floating));
  }
}

TEST(Shell, NoDeformablePointIsNothingToSolve) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  deform::Setup setup = shell(test::sheet_setup());
  setup.handles[0].region = test::box({0.31, -1, -1}, {3, 2, 1});
  const auto system = prepare(mesh, setup);
  EXPECT_EQ(system->info().functions, 0u);
  EXPECT_EQ(system->evaluate(turned)[20], transformed(test::turn_and_shift(), mesh->points[20]));
}

TEST(Shell, FlatTrianglesAreTolerated) {
  Mesh mesh = test::bumpy_sheet(41, 21);
  const auto add = [&](std::initializer_list<PointId> face) {
    mesh.face_sizes.push_back(static_cast<std::uint32_t>(face.size()));
    mesh.face_points.insert(mesh.face_points.end(), face);
  };
  mesh.points.push_back(mesh.points[430]);
  add({430, 431, 861});
  add({500, 500, 501});
  const auto system = prepare(shared(mesh), shell(test::sheet_setup()));
  ASSERT_FALSE(system->info().notes.empty());
  EXPECT_NE(system->info().notes[0].find("flat"), std::string::npos) << system->info().notes[0];
  const Points got = system->evaluate(turned);
  EXPECT_LT(distance(got[861], got[430]), 1e-3);
  const Points clean = prepare(shared(test::bumpy_sheet(41, 21)), shell(test::sheet_setup()))->evaluate(turned);
  EXPECT_LT(distance(got[430], clean[430]), 1e-2);
}

TEST(Shell, SoftHandlesReportTheirMisfit) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  ShellOptions options;
  options.handles = HandleMode::soft;
  const auto system = prepare(mesh, shell(test::sheet_setup(), options));
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const auto evaluation = system->bind({&turned, 1}, path, {});
    const Points got = system->evaluate({&turned, 1}, path)[0];
    double misfit = 0;
    const SelectedRegions regions = validate(test::sheet_setup(), *mesh);
    for (const PointId id : regions.handles[0]) {
      misfit = std::max(misfit, distance(got[id], transformed(test::turn_and_shift(), mesh->points[id])));
    }
    EXPECT_GT(misfit, 1e-4);
    EXPECT_LE(misfit, evaluation->report(0).interpolation_residual * 1.05);
  }
}

TEST(Shell, StopsWhenTold) {
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  test::expect_error(ErrorCode::cancelled, {},
                     [&] { prepare(shared(test::bumpy_sheet(21, 11)), shell(test::sheet_setup()), context); });
}

// The energy is assembled a block of columns at a time; here there are two.
TEST(Shell, TheBendingEnergyOfManyPointsIsTheWholeProduct) {
  const Mesh mesh = test::bumpy_sheet(181, 101);
  ShellOptions options;
  options.handles = HandleMode::soft;
  options.bending = 3;
  const EnergyModel model = shell_model(mesh, std::vector<RegionIndex>(mesh.point_count(), fixed_region), options, 1);
  const ShellOperators operators = shell_operators(mesh, 1);
  const SparseMatrix scaled = operators.areas.cwiseInverse().asDiagonal() * operators.laplacian;
  const SparseMatrix product = 3 * SparseMatrix(SparseMatrix(operators.laplacian * scaled).triangularView<Eigen::Lower>());
  ASSERT_EQ(model.space.energy.cols(), product.cols());
  EXPECT_LT(SparseMatrix(model.space.energy - product).norm(), 1e-14 * product.norm());
  EXPECT_TRUE(model.space.energy.isCompressed());
}

TEST(Shell, PreparingCanBeStoppedBeforeThereIsASystem) {
  std::stop_source stop;
  RunContext context;
  context.stop = stop.get_token();
  stop.request_stop();
  const Mesh mesh = test::bumpy_sheet(21, 11);
  const SelectedRegions regions = validate(test::sheet_setup(), mesh);
  test::expect_error(ErrorCode::cancelled, {}, [&] { constraint_points(mesh, regions, context); });
  const std::vector<RegionIndex> region_of = constraint_points(mesh, regions).region_of;
  test::expect_error(ErrorCode::cancelled, {}, [&] { shell_model(mesh, region_of, {}, 1, context); });
}

}  // namespace
}  // namespace deform::shell_test
