// SPDX-License-Identifier: GPL-3.0-or-later
// Systems over subspaces and moving least squares: hard and soft handles, basis, derivatives.
#include <gtest/gtest.h>

#include <cmath>

#include "core/deformers/energy/energy_system.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/support/thesis_options.h"

namespace deform::spaces_test {
namespace {

using test::distance;
using test::shared;

const Design turned{{}, {{0, test::turn_and_shift()}}};

deform::Setup with(deform::Setup setup, const SubspaceOptions& options) {
  setup.method = options;
  return setup;
}

SubspaceOptions subspace(std::optional<Kernel> kernel, std::size_t centres = 250) {
  SubspaceOptions options = test::thesis_subspace();
  options.kernel = kernel;
  options.centres = centres;
  options.cover = kernel == Kernel::wendland_c2 ? 50 : 8;  // thesis 8.3.2: less leaves kinks
  return options;
}

TEST(Spaces, HardHandlesAreMet) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  const SelectedRegions regions = validate(test::sheet_setup(), *mesh);
  deform::Setup of_shell = test::sheet_setup();
  of_shell.method = ShellOptions{};
  const Points shell = prepare(mesh, of_shell)->evaluate(turned);
  for (const std::optional<Kernel> kernel : std::vector<std::optional<Kernel>>{std::nullopt, Kernel::wendland_c2}) {
    const auto system = prepare(mesh, with(test::sheet_setup(), subspace(kernel)));
    EXPECT_EQ(system->info().solver, Solver::cholesky);
    EXPECT_EQ(system->info().samples, 250u);
    const Points got = system->evaluate(turned);
    for (const PointId id : regions.fixed) EXPECT_EQ(got[id], mesh->points[id]);
    for (const PointId id : regions.handles[0]) {
      EXPECT_EQ(got[id], transformed(test::turn_and_shift(), mesh->points[id]));
    }
    for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
      EXPECT_LT(system->bind({&turned, 1}, path, {})->report(0).interpolation_residual, 1e-3);
    }
    // No tear between the held points and their neighbours: these edges are about as long as those of the shell.
    double worst = 0;
    for (std::size_t j = 0; j < 21; ++j) {
      for (const std::size_t i : {std::size_t{6}, std::size_t{33}}) {
        const std::size_t a = 41 * j + i;
        const double length = distance(shell[a], shell[a + 1]);
        worst = std::max(worst, std::abs(distance(got[a], got[a + 1]) / length - 1));
      }
    }
    EXPECT_LT(worst, 0.3) << (kernel ? "wendland_c2" : "mls");
  }
}

TEST(Spaces, BasisEqualsDirectSolve) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  for (const std::optional<Kernel> kernel : std::vector<std::optional<Kernel>>{std::nullopt, Kernel::wendland_c2}) {
    const auto system = prepare(mesh, with(test::sheet_setup(), subspace(kernel)));
    const Points basis = system->evaluate({&turned, 1}, EvaluationPath::basis)[0];
    const Points direct = system->evaluate({&turned, 1}, EvaluationPath::direct)[0];
    EXPECT_LE(distance(basis, direct), 1e-8 * system->info().diagonal);
  }
}

TEST(Spaces, FewFunctionsComeNearTheShell) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  deform::Setup setup = test::sheet_setup();
  setup.method = ShellOptions{};
  const Points expected = prepare(mesh, setup)->evaluate(turned);
  const Points got = prepare(mesh, with(setup, subspace(std::nullopt, 400)))->evaluate(turned);
  EXPECT_LT(distance(got, expected), 0.04);
}

TEST(Spaces, JacobianProducts) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  for (const HandleMode handles : {HandleMode::hard, HandleMode::soft}) {
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      SubspaceOptions options = subspace(std::nullopt, 120);
      options.handles = handles;
      options.basis = basis;
      test::check_jacobians(*prepare(mesh, with(test::setup_with_variables(), options)), 1e-8, 1e-6);
    }
  }
}

TEST(Spaces, PopulationsEqualSingles) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  test::check_population(*prepare(mesh, with(test::setup_with_variables(), subspace(std::nullopt, 150))), 5);
}

TEST(Spaces, VolumesMoveWithMovingLeastSquares) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  deform::Setup setup = test::sheet_setup();
  MlsOptions options = test::thesis_mls();
  options.surface_samples = 200;
  setup.method = options;
  const auto system = prepare(mesh, setup);
  EXPECT_GT(system->info().cubature_points, 0u);
  const SelectedRegions regions = validate(setup, *mesh);
  const Points got = system->evaluate(turned);
  for (const PointId id : regions.handles[0]) {
    EXPECT_EQ(got[id], transformed(test::turn_and_shift(), mesh->points[id]));
  }
  EXPECT_LT(system->bind({&turned, 1}, EvaluationPath::automatic, {})->report(0).interpolation_residual, 1e-3);
  const Estimate expected = estimate(*mesh, setup);
  EXPECT_GE(expected.peak_bytes, system->info().bytes);
  EXPECT_EQ(expected.samples, 200u);
}

TEST(Spaces, ConstraintsHoldInSpaces) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  deform::Setup setup = with(test::setup_with_variables(), subspace(std::nullopt, 120));
  setup.constraints = {{"patch", {test::box({1.2, 0.1, -9}, {1.6, 0.9, 9})}, Planar{}, 1e6}};
  const auto system = prepare(mesh, setup);
  const Design design{{0.4, 0.5, 0.2, -0.4}, {}};
  const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
  const DesignReport& report = evaluation->report(0);
  EXPECT_TRUE(report.converged);
  EXPECT_LT(report.constraints[0].rms, 0.3 * report.constraints[0].rms_before);
  test::check_jacobians(*system, 1e-6, 2e-2);
}

}  // namespace
}  // namespace deform::spaces_test
