// SPDX-License-Identifier: GPL-3.0-or-later
// What validate() refuses and how it says so; motions of design variables and their derivatives.
#include "core/deformers/setup.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "tests/core/deformers/block_meshes.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/expect_error.h"

namespace deform::setup_test {
namespace {

using test::box;

Setup good() {
  deform::Setup setup = test::sheet_setup();
  setup.handles.push_back({"middle", box({0.9, -1, -1}, {1.1, 2, 1})});
  setup.variables.push_back({"up", "end", DesignVariable::Translate{{0, 0, 2}}, -1, 1});
  setup.variables.push_back({"turn", "end", DesignVariable::Rotate{{0, 3, 0}, {1.8, 0, 0.1}}, -2, 2});
  setup.variables.push_back({"grow", "end", DesignVariable::Scale{{1.8, 0.5, 0}, {}}, -0.5, 0.5});
  setup.variables.push_back({"widen", "middle", DesignVariable::Scale{{1, 0.5, 0}, {0, 2, 0}}, -0.5, 0.5});
  return setup;
}

struct BadSetup {
  const char* name;
  std::function<void(Setup&)> spoil;
  std::vector<const char*> parts;
};

RbfOptions& options(Setup& setup) { return std::get<RbfOptions>(setup.method); }
ShellOptions& shell(Setup& setup) { return setup.method.emplace<ShellOptions>(); }
SubspaceOptions& subspace(Setup& setup) { return setup.method.emplace<SubspaceOptions>(); }
MlsOptions& mls(Setup& setup) { return setup.method.emplace<MlsOptions>(); }

/// One on the handle "end", of the method mls.
Constraint& constrain(Setup& setup, const ConstraintKind& kind = Planar{}) {
  setup.method = MlsOptions{};
  setup.constraints.push_back({"kept", {setup.handles[0].region}, kind});
  return setup.constraints.back();
}

const double nan = std::numeric_limits<double>::quiet_NaN();

const std::vector<BadSetup>& bad_setups() {
  static const std::vector<BadSetup> table = {
      {"no handle", [](Setup& s) { s.handles.clear(); }, {"handles", "at least one"}},
      {"empty name", [](Setup& s) { s.handles[1].name.clear(); }, {"handles[1].name", "empty"}},
      {"repeated name", [](Setup& s) { s.handles[1].name = "end"; }, {"handles[1].name", "\"end\"", "twice"}},
      {"empty handle",
       [](Setup& s) {
         s.handles[1].region = box({9, 9, 9}, {10, 10, 10});
       },
       {"handle \"middle\"", "no point", "the model's box is [0, 0, "}},
      {"empty fixed",
       [](Setup& s) {
         s.fixed.push_back(box({9, 9, 9}, {10, 10, 10}));
       },
       {"fixed[1]", "no point; the model's box is ["}},
      {"two handles overlap",
       [](Setup& s) {
         s.handles[1].region = box({1.6, -1, -1}, {3, 2, 1});
       },
       {"handle \"middle\"", "overlaps handle \"end\"", "the first is point 17", "difference"}},
      {"handle and fixed overlap", [](Setup& s) { s.fixed.push_back({Region::All{}}); }, {"fixed[1]", "overlaps handle"}},
      {"unknown group", [](Setup& s) { s.handles[0].region = {Region::GroupName{"roof"}}; }, {"handle \"end\"", "\"roof\""}},
      {"id out of range", [](Setup& s) { s.fixed[0] = {Region::Ids{{4711}}}; }, {"fixed[0]", "4711"}},
      {"empty variable name", [](Setup& s) { s.variables[2].name.clear(); }, {"variables[2].name", "empty"}},
      {"repeated variable", [](Setup& s) { s.variables[1].name = "up"; }, {"variables[1].name", "\"up\"", "twice"}},
      {"unknown handle", [](Setup& s) { s.variables[3].handle = "midle"; }, {"\"widen\"", "\"midle\"", "\"middle\""}},
      {"bounds without the rest position",
       [](Setup& s) { s.variables[0].lower = 0.5; },
       {"\"up\"", "rest position", "lower = 0.5"}},
      {"bounds the wrong way",
       [](Setup& s) {
         s.variables[0].lower = 0.2;
         s.variables[0].upper = -0.2;
       },
       {"\"up\"", "lower = 0.2 is above upper = -0.2"}},
      {"0 out of bounds", [](Setup& s) { s.variables[0].upper = -0.5; }, {"\"up\"", "0", "-0.5"}},
      {"NaN bound", [](Setup& s) { s.variables[0].upper = nan; }, {"\"up\"", "numbers"}},
      {"zero direction", [](Setup& s) { s.variables[0].kind = DesignVariable::Translate{}; }, {"\"up\"", "translate", "zero"}},
      {"NaN direction",
       [](Setup& s) {
         s.variables[0].kind = DesignVariable::Translate{{nan, 0, 0}};
       },
       {"translate", "finite"}},
      {"zero axis", [](Setup& s) { s.variables[1].kind = DesignVariable::Rotate{}; }, {"\"turn\"", "rotate.axis", "zero"}},
      {"NaN centre",
       [](Setup& s) {
         s.variables[1].kind = DesignVariable::Rotate{{0, 0, 1}, {nan, 0, 0}};
       },
       {"rotate.centre", "finite"}},
      {"infinite scale centre",
       [](Setup& s) {
         s.variables[2].kind = DesignVariable::Scale{{HUGE_VAL, 0, 0}, {}};
       },
       {"scale.centre", "finite"}},
      {"shape -1", [](Setup& s) { options(s).shape = -1; }, {"method.rbf.shape", "100"}},
      {"shape NaN", [](Setup& s) { options(s).shape = nan; }, {"method.rbf.shape"}},
      {"no rings", [](Setup& s) { options(s).reduction_rings = 0; }, {"reduction_rings", "1..100"}},
      {"too many rings", [](Setup& s) { options(s).reduction_rings = 101; }, {"reduction_rings", "101"}},
      {"degree too large", [](Setup& s) { options(s).polynomial_degree = 3; }, {"polynomial_degree", "3"}},
      {"negative stretching", [](Setup& s) { shell(s).stretching = -1; }, {"method.shell.energy.stretching", "-1", "0"}},
      {"NaN bending", [](Setup& s) { subspace(s).bending = nan; }, {"method.subspace.energy.bending", "nan"}},
      {"no energy", [](Setup& s) { mls(s).bending = 0; }, {"method.mls", "stretching", "bending", "both"}},
      {"no fixing", [](Setup& s) { shell(s).fixing = 0; }, {"method.shell.energy.fixing", "over 0", "1e+12"}},
      {"three centres", [](Setup& s) { subspace(s).centres = 3; }, {"method.subspace.centres", "3", "4..100000"}},
      {"bare cover", [](Setup& s) { mls(s).cover = 4; }, {"method.mls.cover", "5..1000"}},
      {"too many samples", [](Setup& s) { mls(s).volume_samples = 1000001; }, {"method.mls.volume_samples", "1000000"}},
      {"weights nowhere",
       [](Setup& s) {
         mls(s).weights.push_back({box({9, 9, 9}, {10, 10, 10})});
       },
       {"method.mls.weights[0]", "no point; the model's box is ["}},
      {"shape without decay",
       [](Setup& s) { s.method = SubspaceOptions{.kernel = Kernel::multiquadric}; },
       {"method.subspace.kernel", "multiquadric"}},
      {"negative layers", [](Setup& s) { constrain(s, Rigid{-1}); }, {"constraints[0].rigid.layers", "-1", "0..1000"}},
      {"too many layers", [](Setup& s) { constrain(s, Rigid{1001}); }, {"constraints[0].rigid.layers", "1001", "0..1000"}},
      {"layers of a surface", [](Setup& s) { constrain(s, Rigid{2}); }, {"constraints[0].rigid.layers", "no cells"}},
      {"tolerance of constraints",
       [](Setup& s) {
         constrain(s);
         s.constraint_options.tolerance = 0.1;
       },
       {"constraint_options.tolerance", "0.1", "1e-12..0.01"}},
      {"tolerance of no constraints",
       [](Setup& s) { s.constraint_options.tolerance = 1e-13; },
       {"constraint_options.tolerance", "1e-13", "1e-12..0.01"}},
      {"NaN tolerance of constraints",
       [](Setup& s) { s.constraint_options.tolerance = nan; },
       {"constraint_options.tolerance", "nan"}},
      {"no iterations",
       [](Setup& s) { s.constraint_options.iterations = 0; },
       {"constraint_options.iterations", "0", "1..1000000"}},
      {"too many iterations",
       [](Setup& s) { s.constraint_options.iterations = 1000001; },
       {"constraint_options.iterations", "1..1000000"}},
      {"degree too small", [](Setup& s) { options(s).polynomial_degree = -2; }, {"polynomial_degree", "-2"}},
  };
  return table;
}

TEST(Setup, BadOnesAreRefusedByName) {
  const Mesh mesh = test::bumpy_sheet(21, 11);
  EXPECT_NO_THROW(validate(good(), mesh));
  for (const BadSetup& bad : bad_setups()) {
    SCOPED_TRACE(bad.name);
    deform::Setup setup = good();
    bad.spoil(setup);
    test::expect_error(ErrorCode::invalid_argument, bad.parts, [&] { validate(setup, mesh); });
  }
}

TEST(Setup, OptionsOfConstraintsAtTheirLimits) {
  const Mesh mesh = test::bumpy_sheet(21, 11);
  const test::Cube cube = test::cube(2);
  Mesh volume = cube.mesh;
  volume.elements = std::make_shared<const Elements>(cube.elements);
  for (const auto& [tolerance, iterations] : {std::pair(1e-12, 1), std::pair(1e-2, 1000000)}) {
    deform::Setup setup = good();
    constrain(setup, Rigid{}).exact = true;
    setup.constraint_options = {tolerance, iterations};
    EXPECT_NO_THROW(validate(setup, mesh));
    for (const int layers : {1, 1000}) {
      deform::Setup layered;
      layered.handles = {{"top", box({-1, -1, 1}, {2, 2, 1})}};
      layered.method = ShellOptions{};
      layered.constraints = {{"walls", {box({-1, -1, 0}, {2, 2, 0})}, Rigid{layers}}};
      EXPECT_EQ(validate(layered, volume).constraints[0][0].size(), 9u) << "the region; columns are found later";
    }
  }
}

TEST(Setup, RegionsAreSortedAndDisjoint) {
  const Mesh mesh = test::bumpy_sheet(21, 11);
  deform::Setup setup = good();
  setup.fixed.push_back(setup.fixed[0]);  // fixed regions may overlap each other
  const SelectedRegions regions = validate(setup, mesh);
  EXPECT_EQ(regions.handles[0].size(), 4u * 11);
  EXPECT_EQ(regions.handles[1].size(), 3u * 11);
  EXPECT_EQ(regions.fixed.size(), 4u * 11);
  EXPECT_TRUE(std::is_sorted(regions.fixed.begin(), regions.fixed.end()));
}

TEST(Setup, MotionsComposeInOrder) {
  const deform::Setup setup = good();
  const double v[] = {0.5, 0.7, 0.25, -0.5};
  const auto motions = handle_motions(setup, v);
  ASSERT_EQ(motions.size(), 2u);
  const Vec3 p{1.9, 0.3, -0.2};
  Vec3 q{p[0], p[1], p[2] + 1.0};                     // up by 0.5 * 2
  const double c = std::cos(0.7), s = std::sin(0.7);  // right-handed about y: z to x
  q = {1.8 + c * (q[0] - 1.8) + s * (q[2] - 0.1), q[1], 0.1 - s * (q[0] - 1.8) + c * (q[2] - 0.1)};
  q = {1.8 + 1.25 * (q[0] - 1.8), 0.5 + 1.25 * (q[1] - 0.5), 1.25 * q[2]};
  EXPECT_LT(test::distance(transformed(motions[0], p), q), 1e-14);
  EXPECT_LT(test::distance(transformed(motions[1], p), {p[0], 0.5 + 0.5 * (p[1] - 0.5), p[2]}), 1e-14);
}

TEST(Setup, RestIsTheIdentityExactly) {
  deform::Setup setup = good();
  setup.variables[1].kind = DesignVariable::Rotate{{1, 2, 3}, {1e6, -1e6, 3e5}};
  const double zero[] = {0, 0, 0, 0};
  for (const Affine& motion : handle_motions(setup, zero)) EXPECT_EQ(motion, identity_affine);
}

TEST(Setup, DerivativesOfMotionsAgreeWithDifferences) {
  const deform::Setup setup = good();
  const std::vector<double> at{0.5, 0.7, 0.25, -0.3};
  for (std::size_t k = 0; k < at.size(); ++k) {
    constexpr double h = 1e-5;
    auto plus = at, minus = at;
    plus[k] += h;
    minus[k] -= h;
    const auto exact = handle_motion_derivative(setup, at, k);
    const auto above = handle_motions(setup, plus), below = handle_motions(setup, minus);
    for (std::size_t i = 0; i < exact.size(); ++i) {
      for (std::size_t j = 0; j < 12; ++j) EXPECT_NEAR(exact[i][j], (above[i][j] - below[i][j]) / (2 * h), 1e-9) << k;
    }
  }
}

TEST(Setup, WhatRegionsSelectIsClaimedAndMayBeRefused) {
  const Mesh mesh = test::bumpy_sheet(21, 11);
  deform::Setup setup = test::sheet_setup();
  setup.method = MlsOptions{};
  std::size_t claimed = 0;
  RunContext context;
  context.on_claim = [&](std::size_t bytes) { claimed += bytes; };
  SelectedRegions regions = validate(setup, mesh, context);
  std::size_t held = regions.fixed.size();
  for (const auto& ids : regions.handles) held += ids.size();
  EXPECT_EQ(claimed, held * sizeof(PointId));
  setup.constraints.push_back({"flat", {Region{Region::All{}}}, Planar{}});
  const std::size_t before = std::exchange(claimed, 0);
  validate(setup, mesh, context);
  EXPECT_GE(claimed - before, mesh.point_count() * (sizeof(PointId) + sizeof(Vec3)));
  context.on_claim = [](std::size_t bytes) {
    if (bytes >= 231 * sizeof(PointId)) throw Error(ErrorCode::out_of_budget, "too much", 7);
  };
  try {
    validate(setup, mesh, context);
    ADD_FAILURE() << "no error";
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(), "constraints[0].regions[0]: too much");
    EXPECT_EQ(error.retry_after_ms(), 7u);
  }
}

TEST(Setup, DegreesAreRadiansInAnotherUnit) {
  deform::Setup radians = good();
  radians.variables[1].lower = -10;
  radians.variables[1].upper = 10;
  deform::Setup degrees = radians;
  degrees.variables[1].lower = -100;
  degrees.variables[1].upper = 400;
  std::get<DesignVariable::Rotate>(degrees.variables[1].kind).unit = AngleUnit::degrees;
  const double per_unit = std::atan(1.0) / 45;
  for (const double angle : {-90.0, 0.0, 1e-3, 30.0, 180.0, 360.0}) {
    const std::vector<double> in_degrees{0.5, angle, 0.25, 0}, in_radians{0.5, angle * per_unit, 0.25, 0};
    const auto a = handle_motions(degrees, in_degrees), b = handle_motions(radians, in_radians);
    const auto da = handle_motion_derivative(degrees, in_degrees, 1), db = handle_motion_derivative(radians, in_radians, 1);
    for (std::size_t j = 0; j < 12; ++j) {
      EXPECT_NEAR(a[0][j], b[0][j], 1e-14) << angle;
      EXPECT_NEAR(da[0][j], per_unit * db[0][j], 1e-15) << angle;
    }
  }
}

TEST(Setup, AVariableOfSeveralHandlesMovesThemLikeVariablesOfTheirOwn) {
  deform::Setup several = good();
  several.variables[1].also = {{several.handles[1].name, DesignVariable::Rotate{{0, 0, 1}, {1, 0, 0}, AngleUnit::degrees}}};
  deform::Setup single = good();
  single.variables.insert(single.variables.begin() + 2,
                          DesignVariable{"turn too", several.handles[1].name, several.variables[1].also[0].kind});
  EXPECT_NO_THROW(validate(several, test::bumpy_sheet(21, 11)));
  const std::vector<double> at{0.5, 0.7, 0.25, -0.3}, each{0.5, 0.7, 0.7, 0.25, -0.3};
  EXPECT_EQ(handle_motions(several, at), handle_motions(single, each));
  EXPECT_NE(handle_motions(several, at)[1], handle_motions(good(), at)[1]);
  const auto both = handle_motion_derivative(several, at, 1);
  EXPECT_EQ(both[0], handle_motion_derivative(single, each, 1)[0]);
  EXPECT_EQ(both[1], handle_motion_derivative(single, each, 2)[1]);
  EXPECT_EQ(handle_motion_derivative(several, at, 3), handle_motion_derivative(single, each, 4))
      << "behind it, on the same handle";
}

TEST(Setup, HandlesThatAVariableAlsoMovesAreRefusedByName) {
  const auto refused = [](const DrivenHandle& driven, const std::vector<const char*>& parts) {
    deform::Setup setup = good();
    setup.variables[0].also = {{setup.handles[1].name, DesignVariable::Translate{{1, 0, 0}}}, driven};
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { validate(setup, test::bumpy_sheet(21, 11)); });
  };
  const DesignVariable::Translate right{{1, 0, 0}};
  refused({"nobody", right}, {"also[1]", "handle \"nobody\" does not exist"});
  refused({good().handles[0].name, right}, {"also[1]", "moved by this variable already"});
  refused({good().handles[1].name, right}, {"also[1]", "moved by this variable already"});
  deform::Setup setup = good();
  setup.variables[0].also = {{setup.handles[1].name, DesignVariable::Rotate{{0, 0, 0}, {}}}};
  test::expect_error(ErrorCode::invalid_argument, {"also[0]: rotate.axis must not be zero"},
                     [&] { validate(setup, test::bumpy_sheet(21, 11)); });
}

TEST(Setup, ShortAndLongDirectionsAreNotCalledZero) {
  const auto refused = [](const VariableMotion& motion, const char* says) {
    deform::Setup setup = good();
    setup.variables[0].kind = motion;
    test::expect_error(ErrorCode::invalid_argument, {says}, [&] { validate(setup, test::bumpy_sheet(21, 11)); });
  };
  refused(DesignVariable::Rotate{{0, 0, 1e-320}, {}}, "rotate.axis is too short");
  refused(DesignVariable::Scale{{}, {0, 1e-320, 0}}, "scale.axis is too short");
  refused(DesignVariable::Translate{{1.7e308, 1.7e308, 0}}, "translate is too long");
  refused(DesignVariable::Translate{{0, -0.0, 0}}, "translate must not be zero");
  deform::Setup setup = good();
  setup.symmetry = {{SymmetryPlane::Plane{{0, 0, 0}, {0, 1e-320, 0}}}};
  test::expect_error(ErrorCode::invalid_argument, {"symmetry[0].normal: it is too short"},
                     [&] { validate(setup, test::bumpy_sheet(21, 11)); });
}

/// Seen from there, all points are at one place, and preparing fails.
TEST(Setup, AnAxisOfSectorsIsNotTooFarAway) {
  deform::Setup setup = good();
  SectorOptions sector;
  sector.axis = {0, 0, 1};
  sector.count = 4;
  for (const double away : {1e300, 1e11}) {
    sector.origin = {away, 0, 0};
    setup.symmetry = {{sector}};
    test::expect_error(ErrorCode::invalid_argument, {"symmetry[0].sector.origin", "too far"},
                       [&] { validate(setup, test::bumpy_sheet(21, 11)); });
  }
  sector.origin = {1e5, 0, 0};
  setup.symmetry = {{sector}};
  EXPECT_NO_THROW(validate(setup, test::bumpy_sheet(21, 11)));
}

TEST(Setup, ValuesBesideABoundMoveHandlesAsTheBoundDoes) {
  deform::Setup setup = good();
  setup.variables[2].lower = -0.1;
  setup.variables[2].upper = 0.1;
  for (const double bound : {-0.1, 0.1}) {
    const std::vector<double> at{0.5, 0.7, bound, 0}, beside{0.5, 0.7, static_cast<double>(static_cast<float>(bound)), 0};
    ASSERT_GT(std::abs(beside[2]), 0.1);
    EXPECT_EQ(handle_motions(setup, beside), handle_motions(setup, at));
    EXPECT_EQ(handle_motion_derivative(setup, beside, 1), handle_motion_derivative(setup, at, 1));
  }
  test::expect_error(ErrorCode::invalid_argument, {"\"grow\"): 0.100001 is outside of its bounds [-0.1, 0.1]"}, [&] {
    handle_motions(setup, std::vector<double>{0, 0, 0.100001, 0});
  });
}

TEST(Setup, HugeValuesAreRefusedWhereNoNumberHoldsTheMotion) {
  deform::Setup setup = good();
  for (DesignVariable& variable : setup.variables) {
    variable.lower = -std::numeric_limits<double>::infinity();
    variable.upper = std::numeric_limits<double>::infinity();
  }
  setup.variables[3].also = {{"end", DesignVariable::Rotate{{0, 0, 1}, {}, AngleUnit::degrees}}};
  const auto refused = [&](const std::vector<double>& v, const std::vector<const char*>& parts) {
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { handle_motions(setup, v); });
  };
  refused({0, 1e300, 0, 0}, {"variables[1] (\"turn\"): 1e+300 turns by more than 1e12 radians"});
  refused({0, 0, 0, -1e15}, {"variables[3] (\"widen\"): -1e+15 turns by more than 1e12 radians"});
  refused({1e308, 0, 0, 0}, {"variables: they move handle \"end\" farther than a number can say"});
  EXPECT_EQ(handle_motions(setup, std::vector<double>{0.8e308, 0, 0, 0})[0][11], 1.6e308);
  EXPECT_NO_THROW(handle_motions(setup, std::vector<double>{0, 0.9e12, 0, 1e13}));
}

TEST(Setup, BadVariableValuesAreRefusedByName) {
  const deform::Setup setup = good();
  const auto refused = [&](const std::vector<double>& v, const std::vector<const char*>& parts) {
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { handle_motions(setup, v); });
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { handle_motion_derivative(setup, v, 0); });
  };
  refused({0, 0}, {"expected 4", "got 2"});
  refused({0, nan, 0, 0}, {"variables[1]", "\"turn\"", "finite"});
  refused({0, 0, 0.75, 0}, {"variables[2]", "\"grow\"", "0.75", "0.5"});
  test::expect_error(ErrorCode::invalid_argument, {"variable 4"},
                     [&] { handle_motion_derivative(setup, std::vector<double>(4, 0.0), 4); });
}

}  // namespace
}  // namespace deform::setup_test
