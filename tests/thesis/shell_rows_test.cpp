// SPDX-License-Identifier: GPL-3.0-or-later
// Deformation of thin shells: thesis 3.1, 4.2 and 8.2.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "core/deformers/energy/energy_system.h"
#include "core/mesh/operators/shell_operators.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/support/linear_algebra.h"

namespace deform::shell_rows_test {
namespace {

using test::distance;
using test::shared;

struct Weights {
  double bending, stretching;
};

deform::Setup shell(const Weights& weights, HandleMode handles = HandleMode::hard, double fixing = 1000) {
  deform::Setup setup = test::sheet_setup();
  ShellOptions options;
  options.bending = weights.bending;
  options.stretching = weights.stretching;
  options.handles = handles;
  options.fixing = fixing;
  setup.method = options;
  return setup;
}

Affine lift(double height) {
  Affine motion = identity_affine;
  motion[11] = height;
  return motion;
}

/// Change of slope along x from the handle to the cells beside it, in the middle of the sheet.
double slope_jump(const Points& points, std::size_t columns, std::size_t rows, double border) {
  const std::size_t row = columns * (rows / 2);
  std::size_t i = 0;
  while (points[row + i][0] < border) ++i;  // first point of the handle
  const auto slope = [&](std::size_t a) {
    return (points[row + a + 1][2] - points[row + a][2]) / (points[row + a + 1][0] - points[row + a][0]);
  };
  return std::abs(slope(i) - slope(i - 1));
}

// Thesis 3.1: three regimes on a plane; stretching alone breaks the normal at the border of the handle, bending does not.
TEST(ShellEnergies, BendingKeepsTheNormalAtTheBorder) {
  constexpr std::size_t columns = 121, rows = 31;
  const auto mesh = shared(test::flat_sheet(columns, rows));
  double jumps[3];
  const Weights regimes[3] = {{1, 0}, {0, 1}, {10, 1}};
  for (std::size_t r = 0; r < 3; ++r) {
    const auto system = prepare(mesh, shell(regimes[r]));
    const Points got = system->evaluate({{}, {{0, lift(0.3)}}});
    jumps[r] = slope_jump(got, columns, rows, 1.7);
    EXPECT_NEAR(got[columns * (rows / 2) + columns / 2][2], 0.15, 0.02);  // half way up
  }
  RecordProperty("jump_ratio", std::to_string(jumps[1] / jumps[0]));
  EXPECT_GT(jumps[1] / jumps[0], 10);
  EXPECT_LT(jumps[2], jumps[1]);
}

// Thesis 3.1: a translation of all handles is reproduced.
TEST(ShellEnergies, TranslationsAreReproduced) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  Affine motion = lift(0.4);
  motion[3] = -0.7;
  for (const Weights weights : {Weights{1, 0}, Weights{0, 1}, Weights{10, 1}}) {
    deform::Setup setup = shell(weights);
    setup.handles.push_back({"start", setup.fixed[0]});
    setup.fixed.clear();
    const auto system = prepare(mesh, setup);
    const Points got = system->evaluate({{}, {{0, motion}, {1, motion}}});
    for (std::size_t i = 0; i < got.size(); ++i) {
      EXPECT_LE(distance(got[i], transformed(motion, mesh->points[i])), 1e-9 * system->info().diagonal);
    }
  }
}

/// Displacements in z by a dense solution of eq. 3.4 (times M) over all points, nothing reduced.
Eigen::VectorXd dense_solution(const Mesh& mesh, const deform::Setup& setup, const Eigen::VectorXd& prescribed) {
  const auto& options = std::get<ShellOptions>(setup.method);
  const ShellOperators operators = shell_operators(mesh, bounding_box(mesh.points).diagonal());
  const Eigen::MatrixXd L(operators.laplacian);
  const Eigen::MatrixXd K = -options.stretching * L + options.bending * L * operators.areas.cwiseInverse().asDiagonal() * L;
  const SelectedRegions regions = validate(setup, mesh);
  std::vector<char> held(mesh.point_count());
  for (const auto& handle : regions.handles) {
    for (const PointId id : handle) held[id] = 1;
  }
  for (const PointId id : regions.fixed) held[id] = 1;
  std::vector<Eigen::Index> unknown, known;
  for (std::size_t i = 0; i < held.size(); ++i) (held[i] ? known : unknown).push_back(static_cast<Eigen::Index>(i));
  Eigen::VectorXd u = prescribed;
  u(unknown) = -test::ldlt_solution(K(unknown, unknown), K(unknown, known) * prescribed(known));
  return u;
}

// Thesis 3.1: the held points within two rings give the result of all of them.
TEST(ShellRings, TwoRingsAreEnough) {
  const auto mesh = shared(test::bumpy_sheet(33, 17));
  const SelectedRegions regions = validate(test::sheet_setup(), *mesh);
  for (const Weights weights : {Weights{1, 0}, Weights{0, 1}, Weights{0.6, 1}}) {
    const deform::Setup setup = shell(weights);
    const auto system = prepare(mesh, setup);
    EXPECT_TRUE(system->info().reduced);
    Eigen::VectorXd prescribed = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(mesh->point_count()));
    std::vector<Vec3> displacements;
    for (const PointId id : regions.handles[0]) {
      prescribed[id] = std::sin(40 * mesh->points[id][0]) + mesh->points[id][1];
      displacements.push_back({0, 0, prescribed[id]});
    }
    const Eigen::VectorXd expected = dense_solution(*mesh, setup, prescribed);
    const Points got = system->evaluate({{}, {{0, displacements}}});
    for (std::size_t i = 0; i < got.size(); ++i) {
      EXPECT_NEAR(got[i][2] - mesh->points[i][2], expected[static_cast<Eigen::Index>(i)], 1e-10 * system->info().diagonal);
    }
  }
}

// Thesis 4.2: the basis of affine motions gives the direct solution, without solving.
TEST(ShellBasis, BasisEqualsDirectSolve) {
  const auto mesh = shared(test::bumpy_sheet(61, 31));
  for (const Weights weights : {Weights{1, 0}, Weights{0, 1}, Weights{10, 1}}) {
    const auto system = prepare(mesh, shell(weights));
    const Design design{{}, {{0, test::turn_and_shift()}}};
    EXPECT_EQ(system->bind({&design, 1}, EvaluationPath::automatic, {})->report(0).path, EvaluationPath::basis);
    const Points basis = system->evaluate({&design, 1}, EvaluationPath::basis)[0];
    const Points direct = system->evaluate({&design, 1}, EvaluationPath::direct)[0];
    EXPECT_LE(distance(basis, direct), 1e-10 * system->info().diagonal);
  }
}

double handle_error(const Mesh& mesh, const Points& points, const deform::Setup& setup, double height) {
  double largest = 0;
  const SelectedRegions regions = validate(setup, mesh);
  for (const PointId id : regions.handles[0]) {
    largest = std::max(largest, distance(points[id], transformed(lift(height), mesh.points[id])));
  }
  return largest / height;
}

// Thesis 8.2: least squares with weights on a plane of 1100 points; the error of the handle falls, in the end like 1 / gamma_f
// (at 100, the weight of the thesis, it is 8 % of the motion here: its weights depend on the units of its plane).
TEST(LeastSquaresShell, SoftHandles) {
  const auto mesh = shared(test::flat_sheet(44, 25));
  const Design design{{}, {{0, lift(0.3)}}};
  constexpr std::size_t count = 5;
  double errors[count];
  const double fixing[count] = {100, 1000, 1e5, 1e7, 1e8};
  for (std::size_t f = 0; f < count; ++f) {
    const deform::Setup setup = shell({0.6, 1}, HandleMode::soft, fixing[f]);
    errors[f] = handle_error(*mesh, prepare(mesh, setup)->evaluate(design), setup, 0.3);
  }
  EXPECT_LT(errors[0], 0.1);
  for (std::size_t f = 1; f < count; ++f) EXPECT_LT(errors[f], 0.5 * errors[f - 1]) << fixing[f];
  EXPECT_NEAR(errors[3] / errors[4], 10, 1);
  for (const Weights weights : {Weights{1, 0}, Weights{0, 1}, Weights{0.6, 1}}) {
    const Points hard = prepare(mesh, shell(weights))->evaluate(design);
    const Points soft = prepare(mesh, shell(weights, HandleMode::soft, 1e8))->evaluate(design);
    EXPECT_LT(distance(hard, soft), 1e-3 * 0.3);
  }
}

// Thesis 8.2: an orthogonal factorization of the stacked rows (eq. 8.9) agrees with the normal equations.
TEST(LeastSquaresShell, OrthogonalFactorizationAgrees) {
  const auto mesh = shared(test::flat_sheet(22, 13));
  const deform::Setup setup = shell({0.6, 1}, HandleMode::soft, 100);
  const double diagonal = bounding_box(mesh->points).diagonal();
  const ShellOperators operators = shell_operators(*mesh, diagonal);
  const auto n = static_cast<Eigen::Index>(mesh->point_count());
  const Eigen::MatrixXd G(shell_gradient(*mesh, diagonal));
  const Eigen::MatrixXd L = operators.areas.cwiseSqrt().cwiseInverse().asDiagonal() * Eigen::MatrixXd(operators.laplacian);
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(G.rows() + 2 * n, n);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(A.rows());
  A.topRows(G.rows()) = G;
  A.middleRows(G.rows(), n) = std::sqrt(0.6) * L;
  const SelectedRegions regions = validate(setup, *mesh);
  const auto hold = [&](const std::vector<PointId>& ids, double value) {
    const double root = std::sqrt(100.0 / static_cast<double>(ids.size()));
    for (const PointId id : ids) {
      A(G.rows() + n + id, id) = root;
      b[G.rows() + n + id] = root * value;
    }
  };
  hold(regions.handles[0], 0.3);
  hold(regions.fixed, 0);
  const Eigen::VectorXd expected = test::least_squares(A, b);
  const Points got = prepare(mesh, setup)->evaluate({{}, {{0, lift(0.3)}}});
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_NEAR(got[i][2], expected[static_cast<Eigen::Index>(i)], 1e-6 * 0.3);
}

}  // namespace
}  // namespace deform::shell_rows_test
