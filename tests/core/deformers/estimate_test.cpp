// SPDX-License-Identifier: GPL-3.0-or-later
// What is said of a system before it is prepared, against what it takes then.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <array>
#include <ctime>
#include <memory>
#include <string>
#include <vector>

#include "core/deformers/constrained/constraint_sets.h"
#include "core/deformers/energy/energy_system.h"
#include "core/mesh/elements.h"
#include "tests/core/deformers/block_meshes.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/space_cases.h"
#include "tests/support/expect_error.h"
#include "tests/support/thesis_options.h"

namespace deform::estimate_test {
namespace {

using test::box;
using test::shared;

struct Constrained {
  const char* name;
  std::vector<Constraint> constraints;
};

Constraint patch(const std::string& name, double from, double to, const ConstraintKind& kind, bool exact = false) {
  return {name, {box({from, 0.1, -9}, {to, 0.9, 9})}, kind, 0, exact};
}

std::vector<Constrained> constrained() {
  std::vector<Constrained> rows{
      {"none", {}},
      {"one column of points", {patch("a", 1.19, 1.23, Planar{})}},
      {"rigid", {patch("a", 1.2, 1.5, Rigid{})}},
      {"more than half of the points", {patch("a", 0.4, 1.6, Spherical{})}},
      {"exact", {patch("a", 0.4, 1.6, Planar{}, true)}},
      {"exact with common points", {patch("a", 1.2, 1.5, Planar{}, true), patch("b", 1.4, 1.6, Cylindrical{}, true)}},
      {"beside handles", {patch("a", 1.5, 1.9, FixedPlane{{0, 0, 0}, {0, 0, 1}}, true)}},
      {"many", {}},
  };
  for (int i = 0; i < 20; ++i) {
    rows.back().constraints.push_back(patch("p" + std::to_string(i), 0.4 + 0.06 * i, 0.5 + 0.06 * i, Planar{}));
  }
  return rows;
}

void expect_bounds(const std::shared_ptr<const Mesh>& mesh, const deform::Setup& setup, double most) {
  const Estimate expected = estimate(*mesh, setup);
  const auto system = prepare(mesh, setup);
  const SystemInfo& info = system->info();
  EXPECT_GE(expected.factor_bytes, info.factor_bytes);
  EXPECT_GE(expected.basis_bytes, info.basis_bytes);
  EXPECT_GE(expected.resident_bytes, info.bytes);
  EXPECT_LE(static_cast<double>(expected.resident_bytes), most * static_cast<double>(info.bytes));
  EXPECT_GE(expected.peak_bytes, expected.resident_bytes);
  EXPECT_GE(expected.size(), info.centres + info.held_points + info.samples);
}

void expect_bounds(const decltype(deform::Setup::method)& method, std::size_t columns, std::size_t rows, double most) {
  const auto mesh = shared(test::bumpy_sheet(columns, rows));
  for (const Constrained& row : constrained()) {
    SCOPED_TRACE(row.name);
    deform::Setup setup = test::setup_with_variables();
    setup.method = method;
    setup.constraints = row.constraints;
    expect_bounds(mesh, setup, most);
  }
}

TEST(Estimate, OfShells) {
  for (const HandleMode handles : {HandleMode::hard, HandleMode::soft}) {
    ShellOptions options;
    options.handles = handles;
    expect_bounds(options, 41, 21, 1.3);
    expect_bounds(options, 81, 41, 1.3);
  }
}

TEST(Estimate, OfSubspaces) {
  for (const std::optional<Kernel> kernel :
       std::vector<std::optional<Kernel>>{std::nullopt, Kernel::wendland_c2, Kernel::triharmonic}) {
    SCOPED_TRACE(kernel ? properties(*kernel).name : "mls");
    SubspaceOptions options = test::thesis_subspace();
    options.kernel = kernel;
    options.centres = 150;
    expect_bounds(options, 41, 21, 3);
  }
}

TEST(Estimate, OfMovingLeastSquares) {
  MlsOptions options = test::thesis_mls();
  options.surface_samples = 250;
  // Whether Newton's matrix is in the forces, which need N x N numbers, is not known before.
  expect_bounds(options, 41, 21, 3.5);
  options.handles = HandleMode::soft;
  expect_bounds(options, 41, 21, 3.5);
}

deform::Setup cube_setup() {
  deform::Setup setup;
  MlsOptions options = test::thesis_mls();
  options.surface_samples = 200;
  options.volume_samples = 100;
  setup.method = options;
  setup.handles = {{"top", box({-1, -1, 1}, {2, 2, 1})}};
  setup.fixed = {box({-1, -1, -1}, {2, 2, 0})};
  return setup;
}

TEST(Estimate, OfColumnsOfCells) {
  const auto mesh = shared(test::solid_cube(8));
  for (const bool exact : {false, true}) {
    deform::Setup setup = cube_setup();
    setup.constraints = {{"wall", {box({0, 0.2, 0.2}, {0, 0.8, 0.8})}, Rigid{3}, 0, exact}};
    expect_bounds(mesh, setup, 5);  // supports in the volume are wide at corners only, which is not known before
    const auto notes = estimate(*mesh, setup).notes;
    ASSERT_FALSE(notes.empty());
    EXPECT_EQ(notes[0].find("wall: 16 rigid columns of cells, 0 of them of fewer than 3 layers"), 0u) << notes[0];
  }
}

// Points of a column have most control points in common: what meets there is counted once.
TEST(Estimate, OfManySmallSetsInALatticeTakesNoMemoryOfItsOwn) {
  const auto mesh = shared(test::solid_cube(20));
  deform::Setup setup = cube_setup();
  setup.method = FfdOptions{};
  setup.constraints = {{"wall", {box({0, -1, -1}, {0, 2, 2})}, Rigid{5}},
                       {"side", {box({-1, 0, -1}, {2, 0, 2})}, FixedPlane{{0, 0, 0}, {0, 1, 0}}}};
  const auto most_resident = [] {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return static_cast<std::size_t>(usage.ru_maxrss) << 10;
  };
  const std::size_t before = most_resident();
  const Estimate expected = estimate(*mesh, setup);
  EXPECT_LT(most_resident() - before, std::size_t{1} << 29);
  // Newton's matrix is sparse here: three rows per point of the columns, whose entries are in a list and in two matrices.
  constexpr std::size_t columns = 20 * 20, points = 6 * 4, functions = 4 * 4 * 4, entry = 24 + 2 * 16;
  EXPECT_GT(expected.peak_bytes, columns * points * 3 * (3 * functions) * entry);
}

// Cells without any face have all samples inside.
TEST(Estimate, OfCellsWithoutFaces) {
  Mesh bare = test::solid_cube(6);
  bare.face_sizes.clear();
  bare.face_points.clear();
  EXPECT_EQ(estimate(bare, cube_setup()).samples, 300u);
  EXPECT_EQ(prepare(shared(bare), cube_setup())->info().samples, 300u);
}

// All columns of a wall together weigh as much as the constraint, each by its points.
TEST(Estimate, WeightsOfColumns) {
  const Mesh mesh = test::solid_cube(4);
  deform::Setup setup = cube_setup();
  setup.constraints = {{"wall", {box({0, 0.2, 0.2}, {0, 0.8, 0.8})}, Rigid{3}, 7}};
  const ConstraintSets made = constraint_sets(mesh, setup, validate(setup, mesh), UnitBox{});
  ASSERT_GT(made.sets.size(), 1u);
  double weight = 0, points = 0;
  for (const ConstraintSet& set : made.sets) {
    weight += set.weight;
    points += static_cast<double>(set.ids.size());
  }
  EXPECT_NEAR(weight, 7, 1e-12);
  for (const ConstraintSet& set : made.sets) EXPECT_NEAR(set.weight, 7 * static_cast<double>(set.ids.size()) / points, 1e-12);
}

/// Time is told as a ratio of two sizes, of which more points are held: what a processor takes depends on the machine.
TEST(Estimate, SecondsGrowWithWhatIsHeld) {
  SubspaceOptions subspace;
  subspace.centres = 300;
  for (const MethodOptions& method : {MethodOptions{FfdOptions{}}, MethodOptions{subspace}}) {
    deform::Setup setup = test::sheet_setup();
    setup.method = method;
    setup.fixed = {box({-1, -1, -1}, {1.2, 2, 1})};
    struct Seconds {
      double told, taken;
    };
    const auto seconds = [&](std::size_t columns) {
      const auto mesh = shared(test::bumpy_sheet(columns, columns / 2));
      const double told = estimate(*mesh, setup).seconds;
      const std::clock_t start = std::clock();
      prepare(mesh, setup);
      return Seconds{told, static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC};
    };
    const Seconds few = seconds(31), many = seconds(121);
    const double off = (many.told / few.told) / (many.taken / few.taken);
    EXPECT_GT(many.taken, 3 * few.taken);
    EXPECT_LT(off, 4) << method.index();
    EXPECT_GT(off, 0.25) << method.index();
  }
}

/// Nothing is prepared: which of two solvers is said to be the quicker one, and that more points take longer.
TEST(Estimate, SecondsDependOnTheMethod) {
  const auto seconds = [](const MethodOptions& method, std::size_t columns) {
    deform::Setup setup = test::sheet_setup();
    setup.method = method;
    setup.fixed = {box({-1, -1, -1}, {1.2, 2, 1})};
    return estimate(test::bumpy_sheet(columns, columns / 2), setup).seconds;
  };
  const MethodOptions iterative = RbfOptions{.solver = Solver::iterative, .reduction = CentreReduction::off};
  const MethodOptions dense = RbfOptions{.solver = Solver::cholesky, .reduction = CentreReduction::off};
  EXPECT_LT(seconds(iterative, 301), seconds(dense, 301) / 10) << "27,000 centres";
  EXPECT_GT(seconds(iterative, 301), 1);
  FfdOptions direct;
  direct.control = FfdControl::mesh;
  for (const MethodOptions& method : {MethodOptions(direct), iterative, dense}) {
    EXPECT_GT(seconds(method, 31), 0) << method.index();
    EXPECT_GT(seconds(method, 121), 2 * seconds(method, 31)) << method.index();
  }
}

/// Each default is a number of samples of its own. Where faces enclose a volume it does not depend on the points of the mesh;
/// elsewhere, and as setups were stored before, it is no more than these, and at least 64.
TEST(Estimate, SamplesOfMlsByDefault) {
  const auto samples = [](const Mesh& mesh, const MlsOptions& options) {
    deform::Setup setup;
    setup.method = options;
    setup.handles = {{"end", box({0.9, -9, -9}, {9, 9, 9})}};
    return estimate(mesh, setup).samples;
  };
  MlsOptions surface;
  surface.domain = MlsDomain::surface;
  EXPECT_EQ(samples(test::bumpy_sheet(4, 3), surface), 64u);
  EXPECT_EQ(samples(test::bumpy_sheet(31, 16), surface), 31u * 16u);
  EXPECT_EQ(samples(test::bumpy_sheet(121, 61), surface), 4000u);
  surface.surface_samples = 100;
  EXPECT_EQ(samples(test::bumpy_sheet(121, 61), surface), 100u);

  const Mesh block = test::cubes({4, 4, 4}, 0.25, [](int, int, int) { return true; });
  const std::size_t points = block.point_count();
  ASSERT_GT(points, 64u);
  MlsOptions body;
  EXPECT_EQ(samples(block, body), 18000u);
  body.surface_samples = 100;
  EXPECT_EQ(samples(block, body), 10100u);
  body.volume_samples = 50;
  EXPECT_EQ(samples(block, body), 150u);
  EXPECT_EQ(samples(test::bumpy_sheet(31, 16), MlsOptions{}), 31u * 16u) << "faces that do not enclose a volume";
  for (const MlsDomain domain : {MlsDomain::enclosed, MlsDomain::connected}) {
    MlsOptions stored;
    stored.domain = domain;
    EXPECT_EQ(samples(block, stored), 2 * points);
  }
}

/// How much longer a design with constraints takes where more points are constrained, told as a ratio to the one with fewer.
TEST(Estimate, SecondsOfADesignAreToldWithConstraints) {
  SubspaceOptions subspace;
  subspace.centres = 300;
  for (const MethodOptions& method : {MethodOptions{FfdOptions{}}, MethodOptions{subspace}}) {
    deform::Setup setup = test::sheet_setup();
    setup.method = method;
    setup.variables.push_back({"up", "end", DesignVariable::Translate{{0.1, 0, 1}}});
    const auto mesh = shared(test::bumpy_sheet(61, 30));
    EXPECT_EQ(estimate(*mesh, setup).design_seconds, 0) << "without constraints";
    double told[2] = {}, taken[2] = {1e300, 1e300};
    for (const int wide : {0, 1}) {
      setup.constraints.clear();
      Constraint& flat = setup.constraints.emplace_back();
      flat.name = "flat";
      flat.kind = Planar{};
      flat.regions = {box({0.4, -1, -1}, {wide == 1 ? 0.8 : 0.5, 2, 1})};
      told[wide] = estimate(*mesh, setup).design_seconds;
      const auto system = prepare(mesh, setup);
      for (int k = 0; k < 3; ++k) {
        const std::clock_t start = std::clock();
        system->evaluate(Design{{0.05}, {}});
        taken[wide] = std::min(taken[wide], static_cast<double>(std::clock() - start));
      }
    }
    EXPECT_GT(told[1], told[0]) << method.index();
    const double told_ratio = told[1] / told[0], taken_ratio = taken[1] / taken[0];
    EXPECT_LT(told_ratio, 2 * taken_ratio) << method.index();
    EXPECT_GT(told_ratio, taken_ratio / 2) << method.index();
  }
}

/// With few samples in a body with slots most of the time goes to the body and what places see of it, told as a ratio to that of
/// the same surface as a surface.
TEST(Estimate, SecondsOfMlsCountTheBody) {
  const auto fork = shared(test::cubes({60, 12, 21}, 1.0 / 60, [](int i, int /*j*/, int k) { return i < 18 || k / 3 != 3; }));
  struct Seconds {
    double told, taken;
  };
  const auto seconds = [&](MlsDomain domain) {
    MlsOptions options;
    options.surface_samples = 80;
    options.volume_samples = domain == MlsDomain::surface ? 0 : 40;
    options.domain = domain;
    deform::Setup setup;
    setup.method = options;
    setup.handles = {{"end", box({0.9, -9, -9}, {9, 9, 9})}};
    setup.fixed = {box({-9, -9, -9}, {0.05, 9, 9})};
    const double told = estimate(*fork, setup).seconds;
    const std::clock_t start = std::clock();
    prepare(fork, setup);
    return Seconds{told, static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC};
  };
  const Seconds surface = seconds(MlsDomain::surface), body = seconds(MlsDomain::connected);
  const double off = (body.told / surface.told) / (body.taken / surface.taken);
  EXPECT_GT(body.taken, 3 * surface.taken);
  EXPECT_LT(off, 3);
  EXPECT_GT(off, 0.6) << body.told << " told, taken " << body.taken;
}

/// Constraints of delivered points interpolate every function at them, whose coefficients take time however few points there are.
TEST(Estimate, SecondsGrowWithTheFunctionsThatAreInterpolated) {
  const auto seconds = [](std::size_t samples, bool constrained) {
    MlsOptions options;
    options.surface_samples = samples;
    options.basis = BasisMode::never;
    deform::Setup setup = test::sheet_setup();
    setup.method = options;
    if (constrained) setup.constraints = {patch("few", 0.99, 1.01, Planar{})};
    return estimate(test::bumpy_sheet(201, 101), setup).seconds;
  };
  const double few = seconds(500, true) - seconds(500, false), many = seconds(2000, true) - seconds(2000, false);
  EXPECT_GT(few, 0);
  EXPECT_GT(many, 2 * few);
}

TEST(Estimate, RefusesWhatPreparingRefuses) {
  const auto cube = shared(test::solid_cube(4));
  const auto refused = [&](const Constraint& constraint, const std::vector<const char*>& parts) {
    deform::Setup setup = cube_setup();
    setup.constraints = {patch("first", 0.4, 0.6, Planar{}), constraint};
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { estimate(*cube, setup); });
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { prepare(cube, setup); });
  };
  refused({"wall", {box({0.5, 0, 0}, {0.5, 1, 1})}, Rigid{2}}, {"constraints[1].regions[0]", "no face on the boundary"});
  refused({"wall", {{Region::Ids{{0, 1}}}}, Circular{}}, {"constraints[1]", "2 points", "4"});

  // Tetrahedra stand on nothing.
  Mesh tetrahedron;
  tetrahedron.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  auto elements = std::make_shared<Elements>();
  elements->add(ElementType::tetrahedron, std::array<PointId, 4>{0, 1, 2, 3});
  const BoundaryFaces boundary = boundary_faces(*elements);
  tetrahedron.face_sizes = boundary.sizes;
  tetrahedron.face_points = boundary.points;
  tetrahedron.elements = std::move(elements);
  const auto soft = shared(std::move(tetrahedron));
  deform::Setup setup = cube_setup();
  setup.fixed = {{Region::Ids{{0}}}};
  setup.constraints = {{"wall", {{Region::Ids{{0, 1, 2}}}}, Rigid{1}}};
  const std::vector<const char*> parts{"constraints[0].regions[0]", "no prism or hexahedron stands on any of the 1 faces"};
  test::expect_error(ErrorCode::invalid_argument, parts, [&] { estimate(*soft, setup); });
  test::expect_error(ErrorCode::invalid_argument, parts, [&] { prepare(soft, setup); });
}

TEST(Estimate, BudgetsSeeConstraints) {
  const auto mesh = shared(test::bumpy_sheet(81, 41));
  deform::Setup setup = test::setup_with_variables();
  setup.method = ShellOptions{};
  const std::size_t without = estimate(*mesh, setup).peak_bytes;
  setup.constraints = {patch("a", 1, 1.5, Planar{}, true)};
  const std::size_t with = estimate(*mesh, setup).peak_bytes;
  EXPECT_GT(with, 2 * without);
  EXPECT_NO_THROW(prepare(mesh, setup, {}, with));
  test::expect_error(ErrorCode::out_of_budget, {"preparing needs", "available", "constraints"},
                     [&] { prepare(mesh, setup, {}, without); });
}

}  // namespace
}  // namespace deform::estimate_test
