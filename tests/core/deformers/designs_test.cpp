// SPDX-License-Identifier: GPL-3.0-or-later
// What bind() refuses and how it says so; coincident points; systems at the edge: no deformable point, one point, a line.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <thread>

#include "core/base/vectors.h"
#include "core/deformers/rbf/rbf_system.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/expect_error.h"

namespace deform::designs_test {
namespace {

const double nan = std::numeric_limits<double>::quiet_NaN();

Points one(const System& system, const Design& design, EvaluationPath path = EvaluationPath::automatic) {
  return system.evaluate({&design, 1}, path)[0];
}

TEST(Designs, BadOnesAreRefusedByName) {
  deform::Setup setup = test::sheet_setup();
  setup.variables.push_back({"up", "end", DesignVariable::Translate{{0, 0, 1}}, -1, 1});
  const auto system = prepare(test::shared(test::bumpy_sheet(21, 11)), setup);
  const std::size_t count = 44;
  struct Bad {
    Design design;
    std::vector<const char*> parts;
  };
  const auto motion = [](std::size_t handle, std::variant<Affine, std::vector<Vec3>> value) {
    return Design{{}, {{handle, std::move(value)}}};
  };
  Affine broken = identity_affine;
  broken[7] = nan;
  std::vector<Vec3> spoilt(count);
  spoilt[3][1] = nan;
  const std::vector<Bad> table = {
      {{{0.1, 0.2}, {}}, {"designs[1]", "variables", "expected 1", "got 2"}},
      {{{nan}, {}}, {"designs[1]", "\"up\"", "finite"}},
      {{{1.5}, {}}, {"designs[1]", "\"up\"", "1.5", "bounds"}},
      {motion(1, identity_affine), {"designs[1]", "motions[0].handle", "1", "out of range"}},
      {{{}, {{0, identity_affine}, {0, identity_affine}}}, {"motions[1]", "\"end\"", "two motions"}},
      {{{0.5}, {{0, identity_affine}}}, {"\"end\"", "variables"}},
      {motion(0, broken), {"affine[7]", "\"end\"", "finite"}},
      {motion(0, std::vector<Vec3>(5)), {"displacements", "\"end\"", "expected 44", "got 5"}},
      {motion(0, std::vector<Vec3>{}), {"displacements", "expected 44", "got 0"}},
      {motion(0, spoilt), {"displacements[3]", "\"end\"", "finite"}},
  };
  for (const Bad& bad : table) {
    const std::vector<Design> designs{{}, bad.design};
    test::expect_error(ErrorCode::invalid_argument, bad.parts, [&] { system->bind(designs, EvaluationPath::automatic, {}); });
  }
  const std::vector<Design> free{motion(0, std::vector<Vec3>(count))};
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "BASIS", "per point"},
                     [&] { system->bind(free, EvaluationPath::basis, {}); });
  deform::Setup without = setup;
  std::get<RbfOptions>(without.method).basis = BasisMode::never;
  const auto bare = prepare(test::shared(test::bumpy_sheet(21, 11)), without);
  const std::vector<Design> rest(1);
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "BASIS", "without a basis"},
                     [&] { bare->bind(rest, EvaluationPath::basis, {}); });
  test::expect_error(ErrorCode::invalid_argument, {"direction", "expected 1", "got 2"}, [&] {
    system->jacobian_vector(std::vector{0.0}, std::vector{0.0, 0.0}, {});
  });
  test::expect_error(ErrorCode::invalid_argument, {"cotangent", "expected 231", "got 3"},
                     [&] { system->vector_jacobian(std::vector{0.0}, Points(3), {}); });
}

TEST(Designs, TooSmallAPolynomialIsRefused) {
  deform::Setup setup = test::sheet_setup();
  RbfOptions options;
  options.kernel = Kernel::quintic;
  options.polynomial_degree = 1;
  setup.method = options;
  test::expect_error(ErrorCode::invalid_argument, {"polynomial_degree", "quintic", "at least 2"},
                     [&] { prepare(test::shared(test::bumpy_sheet(21, 11)), setup); });
}

TEST(Designs, RestGivesTheSamePoints) {
  const auto mesh = test::shared(test::bumpy_sheet(21, 11));
  const auto system = prepare(mesh, test::sheet_setup());
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    EXPECT_TRUE(one(*system, {}, path) == mesh->points);
  }
  EXPECT_TRUE(system->evaluate(std::span<const Design>{}).empty());
}

// A sheet with a doubled seam in the handle, and one point of the fixed part doubled by a point of the handle.
Mesh with_doubles() {
  Mesh mesh = test::bumpy_sheet(21, 11);
  mesh.points.push_back(mesh.points[20]);  // 231: a handle point again
  mesh.points.push_back(mesh.points[0]);   // 232: a fixed point again
  return mesh;
}

TEST(Designs, CoincidentPointsThatAgreeAreMerged) {
  const auto mesh = test::shared(with_doubles());
  deform::Setup setup = test::sheet_setup();
  std::get<RbfOptions>(setup.method).reduction = CentreReduction::off;
  const auto system = prepare(mesh, setup);
  EXPECT_EQ(system->info().merged_duplicates, 2u);
  EXPECT_EQ(system->info().centres + 2, system->info().constraint_points);
  EXPECT_EQ(system->info().notes.at(0), "2 coincident constraint points were merged with others.");
  Design design;
  design.motions = {{0, test::turn_and_shift()}};
  const Points got = one(*system, design);
  EXPECT_EQ(got[231], got[20]);
  EXPECT_EQ(got[232], got[0]);
}

TEST(Designs, CoincidentPointsThatDisagreeAreRefusedWithBothIds) {
  deform::Setup setup = test::sheet_setup();
  setup.handles[0].region = {Region::Union{{setup.handles[0].region, {Region::Ids{{232}}}}}};
  setup.fixed[0] = {Region::Difference{{setup.fixed[0], {Region::Ids{{232}}}}}};
  const auto system = prepare(test::shared(with_doubles()), setup);
  std::vector<Design> designs(2);
  EXPECT_NO_THROW(system->bind(designs, EvaluationPath::automatic, {}));
  designs[1].motions = {{0, test::turn_and_shift()}};
  test::expect_error(ErrorCode::invalid_argument, {"designs[1]", "0 (fixed)", "232 (handle \"end\")"},
                     [&] { system->bind(designs, EvaluationPath::automatic, {}); });
  // Displacements per point: the doubled handle point 231 goes elsewhere than 20.
  const auto ids = validate(setup, with_doubles()).handles[0];
  std::vector<Vec3> displacement(ids.size());
  displacement[static_cast<std::size_t>(std::find(ids.begin(), ids.end(), 231u) - ids.begin())] = {0, 0, 0.1};
  designs[1].motions = {{0, displacement}};
  test::expect_error(ErrorCode::invalid_argument, {"designs[1]", "20 (handle \"end\")", "231 (handle \"end\")"},
                     [&] { system->bind(designs, EvaluationPath::automatic, {}); });
}

TEST(Designs, NothingDeformable) {
  const auto mesh = test::shared(test::bumpy_sheet(8, 5));
  deform::Setup setup;
  setup.handles = {{"all", {Region::All{}}}};
  const auto system = prepare(mesh, setup);
  EXPECT_EQ(system->info().deformable_points, 0u);
  Design design;
  design.motions = {{0, test::turn_and_shift()}};
  for (const EvaluationPath path : {EvaluationPath::automatic, EvaluationPath::direct}) {
    const Points got = one(*system, design, path);
    for (std::size_t i = 0; i < got.size(); ++i) EXPECT_EQ(got[i], transformed(test::turn_and_shift(), mesh->points[i]));
  }
  EXPECT_EQ(estimate(*mesh, setup).centres, system->info().centres);
}

TEST(Designs, OneConstraintPointTranslatesEverything) {
  const auto mesh = test::shared(test::bumpy_sheet(21, 11));
  deform::Setup setup;
  setup.handles = {{"point", {Region::Ids{{7}}}}};
  const auto system = prepare(mesh, setup);
  EXPECT_EQ(system->info().affine_hull_dimension, 0);
  EXPECT_EQ(system->info().polynomial_terms, 1u);
  Design design;
  design.motions = {{0, Affine{1, 0, 0, 0.5, 0, 1, 0, -1, 0, 0, 1, 2}}};
  const Points got = one(*system, design);
  for (std::size_t i = 0; i < got.size(); ++i) {
    const Vec3& p = mesh->points[i];
    EXPECT_LT(test::distance(got[i], {p[0] + 0.5, p[1] - 1, p[2] + 2}), 1e-12);
  }
}

TEST(Designs, CentresOnALineKeepTheInterpolant) {
  Mesh flat = test::bumpy_sheet(21, 11);
  deform::Setup setup;
  setup.handles = {{"tip", {Region::Ids{{0, 5, 10, 15, 20}}}}};  // the row y = 0 of the bumpy sheet, flattened
  for (Vec3& p : flat.points) p[2] = 0;
  const auto mesh = test::shared(flat);
  const auto system = prepare(mesh, setup);
  EXPECT_EQ(system->info().affine_hull_dimension, 1);
  EXPECT_EQ(system->info().polynomial_terms, 2u);
  ASSERT_FALSE(system->info().notes.empty());
  EXPECT_THAT(system->info().notes, testing::Contains(testing::HasSubstr("on a line")));
  Design design;
  design.motions = {{0, Affine{1.2, 0, 0, 0, 0.1, 1, 0, 0, 0, 0, 1, 0.3}}};
  const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
  EXPECT_LT(evaluation->report(0).interpolation_residual, 1e-12);
  EXPECT_LT(test::distance(one(*system, design, EvaluationPath::basis), one(*system, design, EvaluationPath::direct)), 1e-12);
}

TEST(Designs, UnitsDoNotMatter) {
  const Mesh metres = test::bumpy_sheet(21, 11);
  Mesh millimetres = metres;
  for (Vec3& p : millimetres.points) p = {p[0] * 1000 + 5e4, p[1] * 1000 - 2e4, p[2] * 1000};
  deform::Setup small = test::sheet_setup(), large;
  large.handles = {{"end", {Region::Ids{validate(small, metres).handles[0]}}}};
  large.fixed = {{Region::Ids{validate(small, metres).fixed}}};
  Design design;
  design.motions = {{0, Affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.2}}};
  const Points a = one(*prepare(test::shared(metres), small), design);
  std::get<Affine>(design.motions[0].value)[11] = 200;
  const auto system = prepare(test::shared(millimetres), large);
  const Points b = one(*system, design);
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_LT(test::distance({a[i][0] * 1000 + 5e4, a[i][1] * 1000 - 2e4, a[i][2] * 1000}, b[i]), 1e-8);
  }
  EXPECT_LT(system->info().condition, 1e9);
}

TEST(Designs, ManyThreadsShareOneSystem) {
  const auto system = prepare(test::shared(test::bumpy_sheet(61, 31)), test::sheet_setup());
  Design design;
  design.motions = {{0, test::turn_and_shift()}};
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const Points expected = one(*system, design, path);
    std::vector<Points> got(4);
    std::vector<std::thread> threads;
    for (Points& points : got) {
      threads.emplace_back([&] {
        for (int i = 0; i < 5; ++i) points = one(*system, design, path);
      });
    }
    for (auto& thread : threads) thread.join();
    for (const Points& points : got) EXPECT_TRUE(points == expected);
  }
}

TEST(Designs, BudgetIsCheckedBeforeAnythingLarge) {
  const auto mesh = test::shared(test::bumpy_sheet(61, 31));
  const Estimate expected = estimate(*mesh, test::sheet_setup());
  EXPECT_NO_THROW(prepare(mesh, test::sheet_setup(), {}, expected.peak_bytes));
  test::expect_error(ErrorCode::out_of_budget, {"needs", "available", "centres", "smaller"},
                     [&] { prepare(mesh, test::sheet_setup(), {}, expected.peak_bytes - 1); });
}

/// The derivative of a scaling about the origin is the identity as a map, which a motion would be if it moved nothing.
TEST(Designs, ScalingAboutTheOriginMovesEveryPointByItsPlace) {
  const auto mesh = test::shared(test::bumpy_sheet(21, 11));
  MlsOptions mls;
  mls.surface_samples = 80;
  SubspaceOptions subspace;
  subspace.centres = 60;
  FfdOptions direct;
  direct.control = FfdControl::mesh;
  for (const BasisMode basis : {BasisMode::always, BasisMode::never})
    for (MethodOptions method : std::vector<MethodOptions>{RbfOptions{}, ShellOptions{}, subspace, mls, FfdOptions{}, direct}) {
      std::visit([&](auto& options) { options.basis = basis; }, method);
      SCOPED_TRACE(method.index());
      deform::Setup setup = test::sheet_setup();
      setup.method = method;
      setup.variables = {{"size", "end", DesignVariable::Scale{{0, 0, 0}, {}}}};
      const auto system = prepare(mesh, setup);
      const std::vector<double> at{0.0}, direction{1.0};
      const Points rate = system->jacobian_vector(at, direction, {});
      const Points moved = system->evaluate(Design{{0.5}, {}});
      for (std::size_t i = 0; i < rate.size(); ++i) {
        EXPECT_LT(test::distance(mesh->points[i] + 0.5 * rate[i], moved[i]), 1e-9) << i;
      }
    }
}

}  // namespace
}  // namespace deform::designs_test
