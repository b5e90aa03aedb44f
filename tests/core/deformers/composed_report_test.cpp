// SPDX-License-Identifier: GPL-3.0-or-later
// What reports tell of several methods in one setup: the largest prescribed displacement, against maps of affine motions that are
// composed here. Radial basis functions with linear terms that fix nothing move all points by the motion of their handle, so that
// the places between methods are known in closed form.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/methods.h"
#include "core/deformers/space_map.h"
#include "tests/core/deformers/shapes.h"
#include "tests/core/numerics/cages.h"

namespace deform::composed_report_test {
namespace {

using test::box;
using test::shared;
using Map = std::function<Vec3(const Vec3&)>;

Map shift(const Vec3& by) {
  return [by](const Vec3& x) { return Vec3{x[0] + by[0], x[1] + by[1], x[2] + by[2]}; };
}
/// About the line through (1, 0.5) along z, by radians.
Map turn(double angle) {
  return [c = std::cos(angle), s = std::sin(angle)](const Vec3& x) {
    return Vec3{1 + c * (x[0] - 1) - s * (x[1] - 0.5), 0.5 + s * (x[0] - 1) + c * (x[1] - 0.5), x[2]};
  };
}
/// About the middle of the sheet along x, by 1 + value.
Map stretch(double value) {
  return [value](const Vec3& x) { return Vec3{1 + (1 + value) * (x[0] - 1), x[1], x[2]}; };
}

/// A handle in a range of x, and how a method moves it.
struct Step {
  double low, high;
  VariableMotion kind;
  double value;
  Map map;  ///< the same
};

Step shifted(double low, double high, const Vec3& by) { return {low, high, DesignVariable::Translate{by}, 1, shift(by)}; }
Step turned(double low, double high, double angle) {
  return {low, high, DesignVariable::Rotate{{0, 0, 1}, {1, 0.5, 0}}, angle, turn(angle)};
}
Step stretched(double low, double high, double value) {
  return {low, high, DesignVariable::Scale{{1, 0, 0}, {1, 0, 0}}, value, stretch(value)};
}
/// A handle that this design leaves where it is.
Step still(double low, double high) { return {low, high, DesignVariable::Translate{{0, 0, 1}}, 0, nullptr}; }

/// One method for each step, nothing fixed.
deform::Setup chain(const std::vector<Step>& steps) {
  deform::Setup setup;
  setup.method = RbfOptions{};
  for (std::size_t s = 0; s < steps.size(); ++s) {
    if (s > 0) setup.then.push_back({RbfOptions{}, {}});
    const std::string name = "handle " + std::to_string(s);
    setup.handles.push_back({name, box({steps[s].low, -1, -1}, {steps[s].high, 2, 1}), s});
    setup.variables.push_back({"v" + std::to_string(s), name, steps[s].kind});
  }
  return setup;
}

std::vector<double> values(const std::vector<Step>& steps) {
  std::vector<double> result;
  for (const Step& step : steps) result.push_back(step.value);
  return result;
}

/// Where the last method that moves a point sends it, after all before have moved everything.
double expected(const Mesh& mesh, const std::vector<Step>& steps) {
  double largest = 0;
  for (const Vec3& x : mesh.points) {
    std::optional<Vec3> to;
    Vec3 y = x;
    for (const Step& step : steps) {
      if (!step.map) continue;
      y = step.map(y);
      if (x[0] >= step.low && x[0] <= step.high) to = y;
    }
    if (to) largest = std::max(largest, distance(*to, x));
  }
  return largest;
}

MlsOptions few_samples() {
  MlsOptions options;
  options.surface_samples = 80;
  options.volume_samples = 40;
  return options;
}

double told(const System& system, const Design& design, EvaluationPath path = EvaluationPath::automatic) {
  return system.bind({&design, 1}, path, {})->report(0).prescribed_displacement;
}

TEST(ComposedReport, PrescribedDisplacementsAreThoseOfTheChain) {
  const Mesh sheet = test::bumpy_sheet(31, 13);
  const auto mesh = shared(sheet);
  struct Case {
    const char* name;
    std::vector<Step> steps;
  };
  const std::vector<Case> cases{
      {"same", {turned(0.9, 1.4, 0.4), shifted(0.9, 1.4, {0.1, 0, 0.05})}},
      {"same, back", {shifted(0.9, 1.4, {0.3, 0, 0.4}), shifted(0.9, 1.4, {-0.3, 0, -0.3})}},
      {"disjoint", {shifted(0.2, 0.8, {0.1, 0.2, 0}), shifted(1.2, 1.8, {0, -0.05, 0.1})}},
      {"disjoint, turned", {turned(0.2, 0.8, -0.3), turned(1.2, 1.8, 0.2)}},
      {"overlapping", {shifted(0.2, 1.1, {0.2, 0, 0.3}), turned(0.9, 1.8, 0.5)}},
      {"overlapping, back", {shifted(0.2, 1.1, {0, 0, 0.5}), shifted(0.9, 1.8, {0, 0, -0.4})}},
      {"inside, back", {shifted(0.2, 1.9, {0, 0.4, 0}), shifted(0.9, 1.3, {0, -0.1, 0})}},
      {"around, back", {shifted(0.9, 1.3, {0, 0.4, 0}), shifted(0.2, 1.9, {0, -0.3, 0})}},
      {"three, same", {turned(0.9, 1.4, 0.4), stretched(0.9, 1.4, 0.6), shifted(0.9, 1.4, {0.1, 0, 0.3})}},
      {"three, disjoint", {stretched(0.1, 0.6, 0.3), turned(0.8, 1.1, 0.3), shifted(1.5, 1.9, {-0.2, 0, 0.1})}},
      {"three, overlapping", {shifted(0.2, 1.1, {0.2, 0, 0.1}), turned(0.9, 1.6, 0.5), stretched(1.3, 1.9, -0.3)}},
      {"three, the middle one counts",
       {shifted(0.2, 0.6, {0, 0, 0.1}), shifted(0.5, 1.5, {0, 0, 0.6}), shifted(1, 1.9, {0, 0, -0.5})}},
      {"last at rest", {turned(0.9, 1.9, 0.4), shifted(0.2, 0.8, {0, 0, 0.1}), still(0.5, 1.9)}},
      {"middle at rest", {shifted(0.2, 1.1, {0, 0, 0.5}), still(0.2, 1.1), shifted(1.4, 1.9, {0, 0, -0.1})}},
      {"first at rest", {still(0.2, 1.1), turned(1.2, 1.9, 0.4)}}};
  for (const Case& each : cases) {
    SCOPED_TRACE(each.name);
    const auto system = prepare(mesh, chain(each.steps));
    const Design design{values(each.steps), {}};
    const double oracle = expected(sheet, each.steps);
    ASSERT_GT(oracle, 0.05);
    EXPECT_NEAR(told(*system, design), oracle, 1e-11);
    EXPECT_NEAR(told(*system, design, EvaluationPath::direct), oracle, 1e-11);
    EXPECT_NEAR(system->bind_in_space(design, {})->report().prescribed_displacement, oracle, 1e-11);
    EXPECT_EQ(told(*system, Design{std::vector<double>(each.steps.size()), {}}), 0);
    EXPECT_EQ(told(*system, Design{}), 0);
  }
}

/// One of a population, by motions that are given, and point by point.
TEST(ComposedReport, MotionsCountAsVariablesDo) {
  const Mesh sheet = test::bumpy_sheet(31, 13);
  const auto mesh = shared(sheet);
  const std::vector<Step> steps{shifted(0.2, 1.1, {0, 0, 0.5}), shifted(0.9, 1.8, {0, 0, -0.4})};
  const auto system = prepare(mesh, chain(steps));
  const Affine up{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.5};
  const std::size_t second = validate(chain(steps), sheet).handles[1].size();
  const std::vector<Vec3> down(second, {0, 0, -0.4}), nothing(second, Vec3{});
  const std::vector<Design> designs{{{1, 1}, {}},     {}, {{1, 0}, {}}, {{}, {{0, up}, {1, down}}}, {{1, 0}, {{1, nothing}}},
                                    {{}, {{1, down}}}};
  const auto bound = system->bind(designs, EvaluationPath::automatic, {});
  const std::vector<double> oracle{0.5, 0, 0.5, 0.5, 0.5, 0.4};
  for (std::size_t i = 0; i < designs.size(); ++i) EXPECT_NEAR(bound->report(i).prescribed_displacement, oracle[i], 1e-12) << i;
  // Each point has a displacement of its own: the one that moves most is told, whether the first handle lifts it or not.
  std::vector<Vec3> ramp;
  double most = 0.5;
  for (std::size_t i = 0; i < second; ++i) {
    ramp.push_back({0, 0, 0.001 * static_cast<double>(i)});
    most = std::max(most, 0.5 + ramp.back()[2]);  // the first method lifts all by 0.5
  }
  EXPECT_NEAR(told(*system, Design{{1, 0}, {{1, ramp}}}), most, 1e-12);
  EXPECT_GT(most, 0.55);
  // The points of both handles come back: without those of the first alone, what is left is the difference.
  const std::vector<Step> same{shifted(0.2, 1.1, {0, 0, 0.5}), shifted(0.1, 1.8, {0, 0, -0.4})};
  EXPECT_NEAR(told(*prepare(mesh, chain(same)), Design{{1, 1}, {}}), 0.1, 1e-12);
}

/// With fixed points and methods of other kinds: a chain in which one method moves is that method alone, and the points of the
/// last handles are met, so that none but what is beyond them moves farther than is told.
TEST(ComposedReport, OneMethodThatMovesIsThatMethodAlone) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  deform::Setup setup = test::sheet_setup();
  setup.method = ShellOptions{};
  setup.then.push_back({RbfOptions{}, {box({-1, -1, -1}, {0.4, 2, 1}), box({1.5, -1, -1}, {3, 2, 1})}});
  setup.handles.push_back({"hump", box({0.9, 0.3, -1}, {1.1, 0.7, 1}), 1});
  setup.variables = {{"up", "end", DesignVariable::Translate{{0.1, 0.05, 0.4}}},
                     {"turn", "hump", DesignVariable::Rotate{{0, 0.2, 1}, {0.5, 0.5, 0}}}};
  const auto system = prepare(mesh, setup);
  deform::Setup first = setup, second = setup;
  first.then.clear();
  first.handles.pop_back();
  first.variables.pop_back();
  second.method = setup.then[0].method;
  second.fixed = setup.then[0].fixed;
  second.then.clear();
  second.handles = {{"hump", setup.handles[1].region}};
  second.variables.erase(second.variables.begin());
  EXPECT_EQ(told(*system, Design{{0.7, 0}, {}}), told(*prepare(mesh, first), Design{{0.7}, {}}));
  EXPECT_EQ(told(*system, Design{{0, 0.5}, {}}), told(*prepare(mesh, second), Design{{0.5}, {}}));
  // Both: the handles are apart, and the second is turned from where the shell has it.
  const Design both{{0.7, 0.5}, {}};
  const Points got = system->evaluate(both);
  double farthest = 0;
  const SelectedRegions regions = validate(setup, *mesh);
  for (const auto& handle : regions.handles) {
    for (const PointId id : handle) farthest = std::max(farthest, distance(got[id], mesh->points[id]));
  }
  EXPECT_NEAR(told(*system, both), farthest, 1e-14);
}

/// A half model tells what the whole of it does.
TEST(ComposedReport, HalfModelsAreHalfOfTheWhole) {
  const auto half = shared(test::bumpy_sheet(21, 9));
  Mesh whole = *half;
  for (const Vec3& x : half->points) {
    if (x[1] != 0) whole.points.push_back({x[0], -x[1], x[2]});
  }
  whole.face_sizes.clear();
  whole.face_points.clear();
  const std::vector<Step> along{shifted(0.2, 1.3, {0.1, 0, 0.3}), shifted(1.1, 1.8, {0, 0, -0.2})};
  deform::Setup of_half = chain(along), of_whole = chain(along);
  for (deform::Setup* each : {&of_half, &of_whole}) {
    for (Handle& handle : each->handles) {
      const auto& in = std::get<Region::InBox>(handle.region.kind);
      handle.region = box({in.min[0], -0.5, -1}, {in.max[0], 0.5, 1});
    }
    each->variables[1].kind = DesignVariable::Rotate{{0, 1, 0}, {1.5, 0, 0.1}};
    each->fixed = {box({-1, -2, -1}, {0.05, 2, 1})};
  }
  of_half.symmetry = {SymmetryPlane{SymmetryPlane::Plane{{0, 0, 0}, {0, 1, 0}}}};
  const MethodOptions mirrored = few_samples();  // deforms the whole
  for (const MethodOptions& method : {MethodOptions{RbfOptions{}}, MethodOptions{FfdOptions{}}, mirrored}) {
    of_half.method = of_whole.method = method;
    const auto system = prepare(half, of_half), all = prepare(shared(whole), of_whole);
    for (const Design& design : {Design{{0.8, 0.4}, {}}, Design{{0.8, 0}, {}}, Design{{0, 0.4}, {}}}) {
      EXPECT_GT(told(*all, design), 0.05);
      EXPECT_NEAR(told(*system, design), told(*all, design), std::holds_alternative<RbfOptions>(method) ? 1e-9 : 1e-2);
    }
    EXPECT_EQ(told(*system, Design{}), 0);
  }
}

/// Control points of a later lattice carry what has moved near them.
TEST(ComposedReport, ControlPointsAddToWhatMovedNearThem) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  const test::CageMesh around = test::box_cage({0.5, -0.4, -0.5}, {1.5, 1.3, 0.6});
  CageOptions cage;
  cage.vertices = around.vertices;
  cage.triangles = around.triangles;
  std::vector<Step> steps{shifted(1.7, 2.1, {0, 0, 0.3}), shifted(0, 0, {0, 0, 0.2})};
  deform::Setup setup = chain(steps);
  setup.then[0].method = cage;
  setup.handles[1].region = {Region::ControlIds{{0, 1, 2}}};
  const auto everything = prepare(mesh, setup);
  EXPECT_NEAR(told(*everything, Design{{1, 1}, {}}), 0.5, 1e-12);
  EXPECT_NEAR(told(*everything, Design{{1, -2}, {}}), 0.3, 1e-12);  // the end, as the controls come back
  EXPECT_NEAR(told(*everything, Design{{0, 1}, {}}), 0.2, 1e-12);
  EXPECT_NEAR(told(*everything, Design{{1, 0}, {}}), 0.3, 1e-12);
  const std::vector<Vec3> given{{0, 0, 0.1}, {0.4, 0, 0}, {0, 0, 0}};
  EXPECT_NEAR(told(*everything, Design{{1, 0}, {{1, given}}}), 0.5, 1e-12);  // 0.3 up, 0.4 along
  EXPECT_EQ(told(*everything, Design{{0, 0}, {}}), 0);
  // All but the end stays: the cage has its own part only.
  setup.fixed = {box({-1, -1, -1}, {1.65, 2, 1})};
  EXPECT_NEAR(told(*prepare(mesh, setup), Design{{1, 1}, {}}), 0.3, 1e-12);
  EXPECT_NEAR(told(*prepare(mesh, setup), Design{{1, 2}, {}}), 0.4, 1e-12);
  // Around the end, it carries it.
  const test::CageMesh beside = test::box_cage({1.6, -0.4, -0.5}, {2.3, 1.3, 0.6});
  cage.vertices = beside.vertices;
  setup.then[0].method = cage;
  setup.handles[1].region = {Region::ControlIds{{}}};
  for (std::uint32_t i = 0; i < beside.vertices.size(); ++i) {
    if (beside.vertices[i][0] > 2) std::get<Region::ControlIds>(setup.handles[1].region.kind).ids.push_back(i);
  }
  EXPECT_NEAR(told(*prepare(mesh, setup), Design{{1, 1}, {}}), 0.5, 1e-12);
  // The cage first.
  deform::Setup other = chain({shifted(0, 0, {0, 0, 0.2}), shifted(1.7, 2.1, {0, 0, 0.3})});
  other.method = cage;
  other.handles[0].region = {Region::ControlIds{{0, 1, 2}}};
  deform::Setup alone = other;
  alone.then.clear();
  alone.handles.pop_back();
  alone.variables.pop_back();
  const SelectedRegions regions = validate(other, *mesh);
  for (const double up : {1.0, 2.5}) {
    const Points moved = prepare(mesh, alone)->evaluate(Design{{up}, {}});
    double largest = 0.2 * up;
    for (const PointId id : regions.handles[1]) {
      const Vec3 u = moved[id] - mesh->points[id];
      largest = std::max(largest, norm(u + Vec3{0, 0, 0.3}));
    }
    EXPECT_NEAR(told(*prepare(mesh, other), Design{{up, 1}, {}}), largest, 1e-12);
    EXPECT_GT(largest, 0.35);
  }
}

}  // namespace
}  // namespace deform::composed_report_test
