// SPDX-License-Identifier: GPL-3.0-or-later
// All that is wrong with a setup at once.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "core/deformers/system.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/expect_error.h"

namespace deform::find_problems_test {
namespace {

using test::box;
using testing::ElementsAre;
using testing::HasSubstr;

const Region nowhere = box({9, 9, 9}, {10, 10, 10});

deform::Setup good() {
  deform::Setup setup = test::sheet_setup();
  setup.method = MlsOptions{};
  setup.variables.push_back({"up", "end", DesignVariable::Translate{{0, 0, 2}}});
  setup.constraints.push_back({"flat", {box({0.8, -1, -1}, {1.2, 2, 1})}, Planar{}});
  return setup;
}

std::vector<Problem> found_in(const deform::Setup& setup) {
  Problems problems(Problems::Mode::collect);
  find_problems(test::bumpy_sheet(21, 11), setup, problems);
  return problems.list();
}

std::vector<std::string> fields(const std::vector<Problem>& problems) {
  std::vector<std::string> result;
  for (const Problem& p : problems) result.push_back(p.field);
  return result;
}

TEST(FindProblems, FindsNoneInAGoodSetup) { EXPECT_THAT(fields(found_in(good())), ElementsAre()); }

TEST(FindProblems, FindsAllOfThemEachWithItsField) {
  deform::Setup setup = good();
  setup.handles.push_back({"end", nowhere});
  setup.handles.push_back({"over", box({1.6, -1, -1}, {3, 2, 1})});
  setup.fixed.push_back(nowhere);
  setup.fixed.push_back({Region::Ids{{4711}}});
  setup.variables.push_back({"up", "end", DesignVariable::Translate{{0, 0, 1}}});
  setup.variables.push_back({"away", "nobody", DesignVariable::Translate{{0, 0, 1}}});
  std::get<MlsOptions>(setup.method).cover = 4;
  setup.constraints.push_back({"flat", {nowhere}, Planar{}});                   // twice, and nowhere
  setup.constraints.push_back({"round", {{Region::Ids{{1, 2}}}}, Circular{}});  // too few points
  setup.constraints.push_back({"pair", {{Region::All{}}}, Parallel{}});         // one region
  setup.constraints.push_back({"line", {{Region::Ids{{1, 2}}}}, Straight{}});   // too few points
  setup.constraints.push_back({"good", {{Region::Ids{{1, 2, 3}}}}, Straight{}});
  setup.constraint_options.iterations = 0;
  setup.symmetry.push_back({SymmetryPlane::Plane{{0, 0, 0}, {0, 0, 0}}});
  const std::vector<Problem> found = found_in(setup);
  EXPECT_THAT(fields(found),
              ElementsAre("handles[1].name", "variables[1]", "variables[2]", "method.mls.cover", "handles[1].region",
                          "handles[2].region", "fixed[1]", "fixed[2]", "constraint_options", "constraints[1].name",
                          "constraints[1].regions[0]", "constraints[3]", "symmetry", "constraints[2]", "constraints[4]"));
  ASSERT_EQ(found.size(), 15u);
  EXPECT_THAT(found[5].message, HasSubstr("overlaps handle \"end\""));
  EXPECT_THAT(found[13].message, HasSubstr("2 points, circular needs at least 4"));
  EXPECT_THAT(found[14].message, HasSubstr("2 points, straight needs at least 3"));
  test::expect_error(ErrorCode::invalid_argument, {found[0].message.c_str()},
                     [&] { validate(setup, test::bumpy_sheet(21, 11)); });
}

TEST(FindProblems, ControlPointsAreNotLookedForWhereTheMethodIsWrong) {
  deform::Setup setup = good();
  setup.handles.push_back({"corner", {Region::Union{{{Region::ControlIds{{0}}}, nowhere}}}});
  EXPECT_THAT(fields(found_in(setup)), ElementsAre("handles[1].region"));
  std::get<MlsOptions>(setup.method).cover = 4;
  EXPECT_THAT(fields(found_in(setup)), ElementsAre("method.mls.cover"));
}

TEST(FindProblems, SamplesOfWrongVariablesAreNotLookedAt) {
  deform::Setup setup = good();
  setup.constraints.clear();
  setup.method = RbfOptions{.tolerance = 1, .samples = {{0.5}}};
  EXPECT_THAT(fields(found_in(setup)), ElementsAre("method.rbf.tolerance"));
  setup.variables[0].handle = "nobody";
  EXPECT_THAT(fields(found_in(setup)), ElementsAre("variables[0]", "method.rbf.tolerance"))
      << "the tolerance is wrong all the same";
  setup.method = RbfOptions{.solver = Solver::incremental_qr, .samples = {{0.5, 0.5}}};
  EXPECT_THAT(fields(found_in(setup)), ElementsAre("variables[0]")) << "how many numbers a sample has depends on the variables";
}

TEST(FindProblems, FindsAllThatIsWrongWithTheOptionsOfAMethod) {
  const auto found = [](const MethodOptions& method) {
    deform::Setup setup = good();
    setup.constraints.clear();
    setup.method = method;
    const std::vector<Problem> problems = found_in(setup);
    for (const Problem& problem : problems) EXPECT_THAT(problem.message, testing::StartsWith(problem.field)) << problem.message;
    return fields(problems);
  };
  RbfOptions rbf;
  rbf.kernel = Kernel::triharmonic;
  rbf.tolerance = 1;
  rbf.shape = -1;
  rbf.reduction_rings = 101;
  rbf.basis_tolerance = 1;
  rbf.reduction_tolerance = 1;
  rbf.polynomial_degree = 0;
  rbf.samples = {{1}, {0}, {NAN}};
  EXPECT_THAT(found(rbf), ElementsAre("method.rbf.tolerance", "method.rbf.shape", "method.rbf.reduction_rings",
                                      "method.rbf.basis_tolerance", "method.rbf.reduction_tolerance",
                                      "method.rbf.polynomial_degree", "method.rbf.samples[1]", "method.rbf.samples[2]"));
  ShellOptions shell;
  shell.stretching = -1;
  shell.bending = NAN;
  shell.fixing = 0;
  shell.basis_tolerance = 1;
  EXPECT_THAT(found(shell), ElementsAre("method.shell.energy.stretching", "method.shell.energy.bending",
                                        "method.shell.energy.fixing", "method.shell.energy.basis_tolerance"));
  shell = {};
  shell.bending = 0;
  EXPECT_THAT(found(shell), ElementsAre("method.shell.energy"));
  SubspaceOptions subspace;
  subspace.kernel = Kernel::multiquadric;
  subspace.centres = 3;
  subspace.cover = 3;
  subspace.fixing = -1;
  EXPECT_THAT(found(subspace), ElementsAre("method.subspace.energy.fixing", "method.subspace.centres", "method.subspace.cover",
                                           "method.subspace.kernel"));
  MlsOptions mls;
  mls.surface_samples = mls.volume_samples = 1'000'001;
  mls.cubature = 0;
  mls.cover = 4;
  mls.weights = {{nowhere, -1, 1}, {box({-9, -9, -9}, {9, 9, 9}), 0, 0}};
  EXPECT_THAT(found(mls),
              ElementsAre("method.mls.surface_samples", "method.mls.volume_samples", "method.mls.cubature", "method.mls.cover",
                          "method.mls.weights[0].stretching", "method.mls.weights[0]", "method.mls.weights[1]"));
  FfdOptions ffd;
  ffd.control = FfdControl::mesh;
  ffd.stretching = -1;
  ffd.lattice.points = {1, 4, 1};
  ffd.clamp = 1;
  EXPECT_THAT(found(ffd), ElementsAre("method.ffd.energy.stretching", "method.ffd.lattice.points[0]",
                                      "method.ffd.lattice.points[2]", "method.ffd.clamp"));
  ffd = {};
  ffd.lattice.control_points.resize(1);
  ffd.fixing = -1;
  EXPECT_THAT(found(ffd),
              ElementsAre("method.ffd.energy.fixing", "method.ffd.lattice.control_points", "method.ffd.lattice.control_points"));
  CageOptions cage;
  cage.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  cage.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
  cage.control = CageControl::mesh;
  cage.coordinates = CageCoordinates::green;
  cage.basis_tolerance = 1;
  cage.clamp = 1;
  EXPECT_THAT(found(cage), ElementsAre("method.cage.basis_tolerance", "method.cage.coordinates", "method.cage.basis_tolerance",
                                       "method.cage.clamp"));
  cage.triangles.pop_back();
  cage.coordinates = CageCoordinates::mean_value;
  EXPECT_THAT(found(cage), ElementsAre("method.cage", "method.cage.basis_tolerance", "method.cage.clamp"));
}

/// Variables whose designs would be refused; a rotation that starts along the plane and leaves it too.
TEST(FindProblems, FindsVariablesThatLeadOutOfSymmetryPlanes) {
  deform::Setup setup = good();
  setup.constraints.clear();
  setup.symmetry = {{SymmetryPlane::Plane{{0, 0, 0}, {0, 1, 0}}}};
  for (const MethodOptions& method : {MethodOptions{RbfOptions{}}, MethodOptions{ShellOptions{}}}) {
    setup.method = method;
    setup.variables.resize(1);
    EXPECT_THAT(found_in(setup), testing::IsEmpty());
    setup.variables.push_back({"out", "end", DesignVariable::Translate{{0, 1e-3, 1}}});
    setup.variables.push_back({"pitch", "end", DesignVariable::Rotate{{0, 1, 0}, {1.8, 0.5, 0}}});
    setup.variables.push_back({"roll", "end", DesignVariable::Rotate{{1, 0, 0}, {1.8, 0, 0}}});
    setup.variables.push_back({"grow", "end", DesignVariable::Scale{{1.8, 0, 0}, {0, 1, 0}}});
    setup.handles.resize(1);
    const std::vector<Problem> found = found_in(setup);
    EXPECT_THAT(fields(found), ElementsAre("variables[1]", "variables[3]"));
    EXPECT_THAT(found[0].message, testing::AllOf(HasSubstr("\"out\""), HasSubstr("handle \"end\""), HasSubstr("symmetry[0]"),
                                                 HasSubstr("point 17 "), HasSubstr("0.001;")));
  }
  FfdOptions lattice;
  lattice.control = FfdControl::controls;
  lattice.lattice.frame = LatticeFrame{{-0.2, -1.1, -0.6}, {{{2.5, 0, 0}, {0, 2.2, 0}, {0, 0, 1.3}}}};
  lattice.lattice.points = {7, 7, 4};
  setup.method = lattice;
  setup.handles[0].region = {Region::ControlIds{{20, 24}}};  // 20 + 4 lies in the plane
  setup.fixed.clear();
  setup.variables.resize(2);
  EXPECT_THAT(fields(found_in(setup)), ElementsAre("variables[1]"));
  EXPECT_THAT(found_in(setup)[0].message, HasSubstr("control point 24 "));
  // Where a plane is wrong the control points are not known, which is no fault of the handles.
  setup.symmetry.push_back({SymmetryPlane::Plane{{0, 0, 0}, {0, 0, 0}}});
  setup.variables.resize(1);
  EXPECT_THAT(fields(found_in(setup)), ElementsAre("symmetry"));
}

TEST(FindProblems, ANameThatIsUsedTwiceGetsTheNextFreeNumber) {
  deform::Setup setup = good();
  const Region region = setup.handles[0].region;
  setup.handles.push_back({"end", region});
  setup.handles.push_back({"end_2", region});
  EXPECT_THAT(found_in(setup).at(0).message, HasSubstr("handles[1].name: \"end\" is used twice")) << "named as it stands";
  EXPECT_THAT(found_in(setup).at(0).message, HasSubstr("for instance \"end_3\"")) << "\"end_2\" comes after it";
  std::swap(setup.handles[1], setup.handles[2]);
  EXPECT_THAT(found_in(setup).at(0).message, HasSubstr("handles[2].name: \"end\" is used twice"));
  EXPECT_THAT(found_in(setup).at(0).message, HasSubstr("for instance \"end_3\""));
}

/// No points of constraints are selected then, so that nothing can be said about their shapes.
TEST(FindProblems, ConstraintsBesideFurtherMethodsAreRefusedAsAWhole) {
  deform::Setup setup = good();
  setup.variables.clear();
  setup.then.push_back({ShellOptions{}, {}});
  setup.handles.push_back({"middle", box({0.8, -1, -1}, {1.2, 2, 1}), 1});
  for (const MethodOptions& method : {MethodOptions{MlsOptions{}}, MethodOptions{RbfOptions{}}}) {
    setup.method = method;
    const std::vector<Problem> found = found_in(setup);
    ASSERT_THAT(fields(found), ElementsAre("constraints"));
    test::expect_error(ErrorCode::invalid_argument, {found[0].message.c_str()},
                       [&] { prepare(std::make_shared<const Mesh>(test::bumpy_sheet(21, 11)), setup); });
  }
  setup.fixed.push_back(nowhere);
  EXPECT_THAT(fields(found_in(setup)), ElementsAre("constraints", "fixed[1]"));
}

TEST(FindProblems, LeavesOutWhatIsKnownAlready) {
  deform::Setup setup = good();
  setup.fixed.push_back(nowhere);
  setup.constraints[0].regions = {nowhere};
  Problems problems(Problems::Mode::collect);
  const auto known = [] { throw Error(ErrorCode::invalid_argument, "could not be read"); };
  problems.check("fixed[1]", known);
  problems.check("constraints[0]", known);
  find_problems(test::bumpy_sheet(21, 11), setup, problems);
  EXPECT_EQ(problems.list().size(), 2u);
}

}  // namespace
}  // namespace deform::find_problems_test
