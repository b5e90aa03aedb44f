// SPDX-License-Identifier: GPL-3.0-or-later
// Several methods in one setup, against the same methods applied one after the other by hand: each with a setup and a system of
// its own, the second with the places to which the first took its points.
#include "core/deformers/composed/composed_system.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/compiled_form.h"
#include "core/deformers/methods.h"
#include "core/deformers/space_map.h"
#include "core/deformers/splitting.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/numerics/cages.h"
#include "tests/support/expect_error.h"

namespace deform::composed_test {
namespace {

using test::box;
using test::distance;
using test::shared;
using testing::HasSubstr;

FfdOptions lattice(FfdControl control) {
  FfdOptions options;
  options.control = control;
  options.lattice.points = {6, 5, 4};
  return options;
}

FfdOptions fitted_lattice() {
  FfdOptions options = lattice(FfdControl::mesh);
  options.clamp = 1e-4;
  return options;
}

MlsOptions few_samples() {
  MlsOptions options;
  options.surface_samples = 80;
  options.volume_samples = 40;
  return options;
}

/// A coarse motion of the right end, and then the hump in the middle: its handle "hump" is moved by "lift" and "spin", "end" by
/// "up", "turn" and "spin".
deform::Setup two_methods(const MethodOptions& first, const MethodOptions& second) {
  deform::Setup setup = test::sheet_setup();
  setup.method = first;
  setup.then.push_back({second, {box({-1, -1, -1}, {0.4, 2, 1}), box({1.5, -1, -1}, {3, 2, 1})}});
  setup.handles.push_back({"hump", box({0.9, 0.3, -1}, {1.1, 0.7, 1}), 1});
  setup.variables.push_back({"up", "end", DesignVariable::Translate{{0.1, 0.05, 0.4}}});
  setup.variables.push_back({"lift", "hump", DesignVariable::Translate{{0, 0.1, 0.5}}});
  setup.variables.push_back({"turn", "end", DesignVariable::Rotate{{0, 1, 0.2}, {1.8, 0.5, 0}}});
  setup.variables.push_back({"spin", "hump", DesignVariable::Rotate{{0.2, 0.1, 1}, {1, 0.4, 0.1}}});
  setup.variables.back().also.push_back({"end", DesignVariable::Scale{{1.8, 0.5, 0}, {0, 1, 0}}});
  return setup;
}

const std::vector<double> bent{0.5, 0.4, 0.6, 0.7}, shifted{0.5, 0.4, 0, 0};

/// The methods of a setup, each in a setup and system of its own, without variables.
struct ByHand {
  ByHand(const std::shared_ptr<const Mesh>& mesh, const deform::Setup& setup) {
    for (std::size_t s = 0; s <= setup.then.size(); ++s) {
      deform::Setup own;
      own.method = s == 0 ? setup.method : setup.then[s - 1].method;
      own.fixed = s == 0 ? setup.fixed : setup.then[s - 1].fixed;
      for (const Handle& handle : setup.handles) {
        if (handle.stage == s) own.handles.push_back({handle.name, handle.region});
      }
      setups.push_back(own);
      systems.push_back(prepare(mesh, own));
    }
  }
  std::vector<deform::Setup> setups;
  std::vector<std::shared_ptr<const System>> systems;
};

std::vector<std::pair<std::string, std::pair<MethodOptions, MethodOptions>>> pairs() {
  SubspaceOptions subspace;
  subspace.centres = 60;
  return {{"ffd, rbf", {lattice(FfdControl::energy), RbfOptions{}}},
          {"ffd MESH, mls", {fitted_lattice(), few_samples()}},
          {"rbf, shell", {RbfOptions{}, ShellOptions{}}},
          {"subspace, rbf with r", {subspace, RbfOptions{Kernel::biharmonic}}},
          {"shell, ffd", {ShellOptions{}, lattice(FfdControl::energy)}}};
}

TEST(Composed, HandlesStartWhereTheMethodBeforeEnds) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  for (const auto& [name, methods] : pairs()) {
    SCOPED_TRACE(name);
    const deform::Setup setup = two_methods(methods.first, methods.second);
    const auto system = prepare(mesh, setup);
    const ByHand hand(mesh, setup);
    const std::vector<Affine> maps = handle_motions(setup, bent);
    const Points first = hand.systems[0]->evaluate(Design{{}, {{0, maps[0]}}});
    const Points got = system->evaluate(Design{bent, {}});
    const SelectedRegions regions = validate(setup, *mesh);
    ASSERT_EQ(regions.stages.size(), 2u);
    double moved = 0;
    for (const PointId id : regions.handles[1]) {
      EXPECT_LT(distance(got[id], transformed(maps[1], first[id])), 4e-15) << id;
      moved = std::max(moved, distance(first[id], mesh->points[id]));
    }
    EXPECT_GT(moved, 0.01);  // the handle was moved before
    for (const PointId id : regions.stages[1].fixed) EXPECT_EQ(got[id], first[id]) << id;
    // The others: the second method by hand, with what it is told to do with the points of its handle.
    std::vector<Vec3> displacements;
    for (const PointId id : regions.handles[1]) displacements.push_back(transformed(maps[1], first[id]) - first[id]);
    const Points second = hand.systems[1]->evaluate(Design{{}, {{0, displacements}}});
    for (std::size_t i = 0; i < got.size(); ++i) {
      EXPECT_LT(distance(got[i], first[i] + (second[i] - mesh->points[i])), 4e-15) << i;
    }
  }
}

/// Where the first method moves all by a translation, the second has the same problem as on the translated mesh.
TEST(Composed, IsTheSecondSetupOnTheResultOfTheFirst) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  deform::Setup setup = two_methods(RbfOptions{}, RbfOptions{});
  setup.fixed.clear();
  setup.variables[0].kind = DesignVariable::Translate{{0.3, -0.2, 0.7}};
  const std::vector<double> at{1, 0.4, 0, 0.7};
  deform::Setup coarse = setup;
  coarse.variables.back().also.clear();
  const Points got = prepare(mesh, coarse)->evaluate(Design{at, {}});
  Mesh moved = *mesh;
  for (Vec3& x : moved.points) x = x + Vec3{0.3, -0.2, 0.7};
  const ByHand hand(mesh, setup);
  deform::Setup second = hand.setups[1];
  const SelectedRegions regions = validate(setup, *mesh);
  second.handles[0].region = {Region::Ids{regions.handles[1]}};
  second.fixed = {{Region::Ids{regions.stages[1].fixed}}};
  const std::vector<Affine> maps = handle_motions(coarse, at);
  const Points expected = prepare(shared(moved), second)->evaluate(Design{{}, {{0, maps[1]}}});
  EXPECT_LT(distance(got, expected), 1e-11);
  EXPECT_GT(distance(got, moved.points), 0.1);
}

TEST(Composed, TranslationsAddUpOnTheBasis) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  for (const auto& [name, methods] : pairs()) {
    SCOPED_TRACE(name);
    const deform::Setup setup = two_methods(methods.first, methods.second);
    const auto system = prepare(mesh, setup);
    const ByHand hand(mesh, setup);
    const std::vector<Affine> maps = handle_motions(setup, shifted);
    const Points first = hand.systems[0]->evaluate(Design{{}, {{0, maps[0]}}});
    const Points second = hand.systems[1]->evaluate(Design{{}, {{0, maps[1]}}});
    const Design design{shifted, {}};
    const auto bound = system->bind({&design, 1}, EvaluationPath::automatic, {});
    EXPECT_EQ(bound->report(0).path, EvaluationPath::basis);
    const Points got = system->evaluate(design);
    for (std::size_t i = 0; i < got.size(); ++i) EXPECT_EQ(got[i], first[i] + (second[i] - mesh->points[i])) << i;
    // The fields of both methods make up the same points.
    const auto fields = system->displacement_fields();
    ASSERT_NE(fields, nullptr);
    ASSERT_EQ(fields->count(), system->info().basis_fields);
    const auto motion = bound->field_motion(0);
    ASSERT_TRUE(motion.has_value());
    ASSERT_EQ(motion->coefficients.size(), fields->count());
    for (const std::size_t chunk : {fields->count(), std::size_t{3}}) {
      Points sum = mesh->points;
      for (std::size_t f = 0; f < fields->count(); f += chunk) {
        const std::size_t count = std::min(chunk, fields->count() - f);
        std::vector<double> values(count * mesh->point_count());
        fields->values(f, count, values, {});
        for (std::size_t i = 0; i < sum.size(); ++i) {
          for (std::size_t k = 0; k < count; ++k) sum[i] = sum[i] + values[i * count + k] * motion->coefficients[f + k];
        }
      }
      EXPECT_LT(distance(sum, got), 1e-12);
    }
  }
}

std::vector<Design> population(std::size_t count) {
  std::mt19937_64 random(16);
  std::uniform_real_distribution<double> uniform(-0.6, 0.6);
  std::vector<Design> designs(count);
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t k = 0; k < 4; ++k) designs[i].variables.push_back(i % 3 == 0 && k > 1 ? 0 : uniform(random));
  }
  return designs;
}

TEST(Composed, PopulationsAreSingleDesignsBitForBit) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  const std::vector<Design> designs = population(7);
  for (const auto& [name, methods] : pairs()) {
    SCOPED_TRACE(name);
    const auto system = prepare(mesh, two_methods(methods.first, methods.second));
    for (const EvaluationPath path : {EvaluationPath::automatic, EvaluationPath::direct}) {
      const auto together = system->evaluate(designs, path);
      for (std::size_t i = 0; i < designs.size(); ++i) {
        EXPECT_TRUE(system->evaluate({&designs[i], 1}, path)[0] == together[i]) << i;
      }
    }
    const auto bound = system->bind(designs, EvaluationPath::automatic, {});
    for (std::size_t i = 0; i < designs.size(); ++i) {
      EXPECT_EQ(bound->report(i).path, i % 3 == 0 ? EvaluationPath::basis : EvaluationPath::direct) << i;
    }
    // Ranges that cut handles and tiles.
    const Points whole = system->evaluate({&designs[1], 1})[0];
    Points part(100);
    Vec3* out = part.data();
    bound->evaluate(77, 177, 1, {&out, 1});
    EXPECT_TRUE(std::equal(part.begin(), part.end(), whole.begin() + 77));
  }
}

/// Against central differences of the chain, at designs that turn the handle of the second method and at such that do not.
TEST(Composed, DerivativesAreThoseOfTheChain) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  for (const auto& [name, methods] : pairs()) {
    SCOPED_TRACE(name);
    deform::Setup setup = two_methods(methods.first, methods.second);
    test::check_jacobians(*prepare(mesh, setup), 1e-12, 2e-8);
    // No rotation of the second handle: the methods are independent and one adjoint solution of each is enough.
    setup.variables[3].kind = DesignVariable::Translate{{0.2, 0, -0.3}};
    test::check_jacobians(*prepare(mesh, setup), 1e-12, 2e-8);
  }
}

TEST(Composed, ManyCotangentsAreSingleOnes) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  const auto system = prepare(mesh, two_methods(lattice(FfdControl::energy), RbfOptions{}));
  std::mt19937_64 random(17);
  std::normal_distribution<double> normal;
  std::vector<Points> cotangents(3, Points(mesh->point_count()));
  for (Points& cotangent : cotangents) {
    for (Vec3& v : cotangent) v = {normal(random), normal(random), normal(random)};
  }
  const auto together = system->vector_jacobians(bent, cotangents, {});
  ASSERT_EQ(together.size(), 3u);
  for (std::size_t j = 0; j < 3; ++j) EXPECT_EQ(system->vector_jacobian(bent, cotangents[j], {}), together[j]);
}

/// Three methods, of which the last starts where the second ends, in other units far from the origin.
TEST(Composed, ThreeMethodsInMillimetres) {
  Mesh large = test::bumpy_sheet(31, 13);
  const auto to_millimetres = [](const Vec3& x) { return Vec3{1000 * x[0] + 4e4, 1000 * x[1] - 7e3, 1000 * x[2]}; };
  for (Vec3& x : large.points) x = to_millimetres(x);
  const auto mesh = shared(std::move(large));
  const auto region = [&](const Vec3& low, const Vec3& high) { return box(to_millimetres(low), to_millimetres(high)); };
  deform::Setup setup;
  setup.method = lattice(FfdControl::energy);
  setup.handles = {{"end", region({1.7, -1, -1}, {3, 2, 1})},
                   {"hump", region({0.9, 0.3, -1}, {1.1, 0.7, 1}), 1},
                   {"dent", region({0.95, 0.45, -1}, {1.05, 0.6, 1}), 2}};
  setup.fixed = {region({-1, -1, -1}, {0.3, 2, 1})};
  setup.then = {{RbfOptions{}, {region({-1, -1, -1}, {0.4, 2, 1}), region({1.6, -1, -1}, {3, 2, 1})}},
                {ShellOptions{}, {region({-1, -1, -1}, {0.7, 2, 1}), region({1.3, -1, -1}, {3, 2, 1})}}};
  setup.variables = {{"up", "end", DesignVariable::Translate{{0, 100, 400}}},
                     {"tilt", "hump", DesignVariable::Rotate{{1, 0.3, 0}, to_millimetres({1, 0.5, 0.1})}},
                     {"dive", "dent", DesignVariable::Rotate{{0, 1, 0.4}, to_millimetres({1, 0.5, 0})}},
                     {"swell", "dent", DesignVariable::Scale{to_millimetres({1, 0.5, 0}), {}}}};
  const auto system = prepare(mesh, setup);
  const std::vector<double> at{0.3, 0.4, -0.5, 0.2};
  const Points got = system->evaluate(Design{at, {}});
  const ByHand hand(mesh, setup);
  const std::vector<Affine> maps = handle_motions(setup, at);
  const SelectedRegions regions = validate(setup, *mesh);
  Points expected = mesh->points;
  for (std::size_t s = 0; s < 3; ++s) {
    std::vector<Vec3> u;
    for (const PointId id : regions.handles[s]) u.push_back(transformed(maps[s], expected[id]) - expected[id]);
    const Points moved = hand.systems[s]->evaluate(Design{{}, {{0, u}}});
    for (std::size_t i = 0; i < expected.size(); ++i) expected[i] = expected[i] + (moved[i] - mesh->points[i]);
  }
  EXPECT_LT(distance(got, expected), 1e-9 * 2000);
  test::check_jacobians(*system, 1e-12, 2e-5);
}

TEST(Composed, MotionsAreGivenForHandlesOfAnyMethod) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  deform::Setup setup = two_methods(RbfOptions{}, ShellOptions{});
  const auto system = prepare(mesh, setup);
  const std::vector<Affine> maps = handle_motions(setup, bent);
  EXPECT_TRUE(system->evaluate(Design{{}, {{1, maps[1]}, {0, maps[0]}}}) == system->evaluate(Design{bent, {}}));
  // Displacements point by point start at the moved points.
  const ByHand hand(mesh, setup);
  const Points first = hand.systems[0]->evaluate(Design{{}, {{0, maps[0]}}});
  const SelectedRegions regions = validate(setup, *mesh);
  std::vector<Vec3> u;
  for (std::size_t i = 0; i < regions.handles[1].size(); ++i) u.push_back({0.01 * static_cast<double>(i), 0, 0.2});
  const Points got = system->evaluate(Design{{}, {{0, maps[0]}, {1, u}}});
  for (std::size_t i = 0; i < u.size(); ++i) {
    EXPECT_LT(distance(got[regions.handles[1][i]], first[regions.handles[1][i]] + u[i]), 4e-15);
  }
  const auto refused = [&](const std::vector<const char*>& parts, const Design& design, EvaluationPath path) {
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { system->bind({&design, 1}, path, {}); });
  };
  refused({"designs[0]: path BASIS", "\"hump\"", "then[0]", "DIRECT"}, Design{bent, {}}, EvaluationPath::basis);
  refused({"designs[0].motions[0].handle: 2 is out of range", "2 handles"}, Design{{}, {{2, maps[0]}}},
          EvaluationPath::automatic);
  refused({"designs[0].motions[1] (handle \"hump\")", "two motions"}, Design{{}, {{1, maps[1]}, {1, maps[1]}}},
          EvaluationPath::automatic);
  refused({"designs[0].motions[0] (handle \"hump\")", "variables as well"}, Design{bent, {{1, maps[1]}}},
          EvaluationPath::automatic);
  refused({"designs[0].variables", "expected 4"}, Design{{0.1}, {}}, EvaluationPath::automatic);
  refused({"(handle \"hump\")", "expected "}, Design{{}, {{1, std::vector<Vec3>(2)}}}, EvaluationPath::automatic);
}

/// Control points have no moved places: those of a second lattice and cage move from rest.
TEST(Composed, ControlPointsMoveFromRest) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  const test::CageMesh around = test::box_cage({0.5, -0.4, -0.5}, {1.5, 1.3, 0.6});
  CageOptions cage;
  cage.vertices = around.vertices;
  cage.triangles = around.triangles;
  deform::Setup setup = two_methods(RbfOptions{}, cage);
  setup.then[0].fixed.clear();
  setup.handles[1].region = {Region::ControlIds{{0, 1, 2}}};
  const auto system = prepare(mesh, setup);
  const ByHand hand(mesh, setup);
  const std::vector<Affine> maps = handle_motions(setup, bent);
  const Points first = hand.systems[0]->evaluate(Design{{}, {{0, maps[0]}}});
  const Points second = hand.systems[1]->evaluate(Design{{}, {{0, maps[1]}}});
  const Points got = system->evaluate(Design{bent, {}});
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_EQ(got[i], first[i] + (second[i] - mesh->points[i]));
  EXPECT_GT(distance(second, mesh->points), 0.1);
  test::check_jacobians(*system, 1e-12, 2e-8);
}

TEST(Composed, OffTheMeshTheMapsOfAllMethodsAdd) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  const deform::Setup setup = two_methods(lattice(FfdControl::energy), few_samples());
  const auto system = prepare(mesh, setup);
  const Design design{bent, {}};
  const auto map = system->bind_in_space(design, {});
  Points out(mesh->point_count());
  map->evaluate(mesh->points, 0, out, {});
  EXPECT_TRUE(out == system->evaluate({&design, 1}, EvaluationPath::direct)[0]);
  const auto bound = system->bind({&design, 1}, EvaluationPath::direct, {});
  EXPECT_EQ(map->report().path, EvaluationPath::direct);
  EXPECT_EQ(map->report().prescribed_displacement, bound->report(0).prescribed_displacement);
  EXPECT_EQ(map->report().error, bound->report(0).error);
  EXPECT_GT(map->report().error, 0);
  const auto shell = prepare(mesh, two_methods(RbfOptions{}, ShellOptions{}));
  test::expect_error(ErrorCode::failed_precondition, {"then[0]: ", "the shell deforms the faces"},
                     [&] { shell->bind_in_space(design, {}); });
}

/// The half of a sheet with a plane through y = 0 is half of the whole.
TEST(Composed, PlanesHoldForAllMethods) {
  const auto half = shared(test::bumpy_sheet(21, 9));
  deform::Setup setup = two_methods(lattice(FfdControl::energy), RbfOptions{});
  setup.symmetry = {SymmetryPlane{SymmetryPlane::Plane{{0, 0, 0}, {0, 1, 0}}}};
  setup.handles[1].region = box({0.9, -1, -1}, {1.1, 0.4, 1});
  setup.variables[0].kind = DesignVariable::Translate{{0.1, 0, 0.4}};
  setup.variables[1].kind = DesignVariable::Translate{{0.1, 0, 0.5}};
  setup.variables[2].kind = DesignVariable::Rotate{{0, 1, 0}, {1.8, 0, 0}};
  setup.variables[3] = {"spin", "hump", DesignVariable::Rotate{{0, 1, 0}, {1, 0, 0.1}}};
  const auto system = prepare(half, setup);
  const Points got = system->evaluate(Design{bent, {}});
  const std::vector<Affine> maps = handle_motions(setup, bent);
  const SelectedRegions regions = validate(setup, *half);
  deform::Setup first = setup;
  first.then.clear();
  first.handles.pop_back();
  first.variables.clear();
  const Points coarse = prepare(half, first)->evaluate(Design{{}, {{0, maps[0]}}});
  for (const PointId id : regions.handles[1]) EXPECT_LT(distance(got[id], transformed(maps[1], coarse[id])), 1e-12);
  std::size_t on = 0;
  for (std::size_t i = 0; i < got.size(); ++i) {
    if (half->points[i][1] != 0) continue;
    ++on;
    EXPECT_EQ(got[i][1], 0) << i;
  }
  EXPECT_EQ(on, 21u);
  test::check_jacobians(*system, 1e-12, 2e-8);
}

TEST(Composed, WhatCannotWorkIsRefusedWithItsReason) {
  const Mesh mesh = test::bumpy_sheet(31, 13);
  const auto shared_mesh = shared(mesh);
  const deform::Setup setup = two_methods(lattice(FfdControl::energy), RbfOptions{});
  const auto refused = [&](const std::vector<const char*>& parts, const auto& change) {
    deform::Setup changed = setup;
    change(changed);
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { validate(changed, mesh); });
    Problems problems(Problems::Mode::collect);
    validate(changed, mesh, problems);
    ASSERT_EQ(problems.list().size(), 1u) << parts[0];
    for (const char* part : parts) EXPECT_THAT(problems.list()[0].message, HasSubstr(part));
  };
  refused({"constraints: ", "`then`"}, [](auto& s) {
    s.constraints.push_back({"flat", {box({0.9, 0.3, -1}, {1.1, 0.7, 1})}, Planar{}});
  });
  refused({"then[0].handles", "at least one"}, [](auto& s) {
    s.handles.pop_back();
    s.variables.erase(s.variables.begin() + 3);
    s.variables.erase(s.variables.begin() + 1);
  });
  refused({"then[0].method.rbf.tolerance", "1"}, [](auto& s) { std::get<RbfOptions>(s.then[0].method).tolerance = 1; });
  refused({"then[0].fixed[1]", "handle \"hump\""}, [](auto& s) { s.then[0].fixed[1] = box({1, -1, -1}, {3, 2, 1}); });
  refused({"then[0]: handle \"hump\"", "no point"}, [](auto& s) { s.handles[1].region = box({9, 9, 9}, {10, 10, 10}); });
  refused({"handles[1].name", "\"end\"", "twice"}, [](auto& s) {
    s.handles[1].name = "end";
    s.variables.erase(s.variables.begin() + 3);
    s.variables.erase(s.variables.begin() + 1);
  });
  refused({"then: 8 methods", "limit of 7"}, [](auto& s) {
    for (std::size_t i = 2; i <= 8; ++i) {
      s.then.push_back(s.then[0]);
      s.handles.push_back({"hump" + std::to_string(i), s.handles[1].region, i});
    }
  });
  const auto system = prepare(shared_mesh, setup);
  test::expect_error(ErrorCode::failed_precondition, {"cannot be compiled", "several methods"},
                     [&] { CompiledForm form(system); });
  SplitProblem split;
  split.mesh = shared_mesh;
  split.setup = setup;
  test::expect_error(ErrorCode::invalid_argument, {"splitting", "`then`"}, [&] { evaluate_split(split, Design{bent, {}}); });
  test::expect_error(ErrorCode::invalid_argument, {"cotangent"}, [&] { system->vector_jacobian(bent, Points(3), {}); });
  test::expect_error(ErrorCode::invalid_argument, {"direction"},
                     [&] { system->jacobian_vector(bent, std::vector<double>(1), {}); });
}

TEST(Composed, EstimatesAndFactsAreThoseOfAllMethods) {
  const auto mesh = shared(test::bumpy_sheet(61, 31));
  const deform::Setup setup = two_methods(lattice(FfdControl::energy), RbfOptions{});
  const Estimate expected = estimate(*mesh, setup);
  const auto system = prepare(mesh, setup);
  const SystemInfo& info = system->info();
  test::expect_bounds(expected, info);
  EXPECT_EQ(expected.centres, info.centres);
  const ByHand hand(mesh, setup);
  EXPECT_EQ(info.bytes, hand.systems[0]->info().bytes + hand.systems[1]->info().bytes);
  EXPECT_EQ(info.basis_fields, 8u);
  EXPECT_EQ(info.points, mesh->point_count());
  EXPECT_EQ(info.handle_points + info.fixed_points + info.deformable_points, info.points);
  const SelectedRegions regions = validate(setup, *mesh);
  EXPECT_EQ(info.handle_points, regions.handles[0].size() + regions.handles[1].size());
  std::vector<PointId> both;
  std::set_intersection(regions.fixed.begin(), regions.fixed.end(), regions.stages[1].fixed.begin(),
                        regions.stages[1].fixed.end(), std::back_inserter(both));
  EXPECT_EQ(info.fixed_points, both.size());
  bool factor = false;
  for (const auto& [name, seconds] : info.stage_seconds) factor = factor || name == "then[0] factor";
  EXPECT_TRUE(factor);
  // Both fit, or none is prepared.
  EXPECT_NO_THROW(prepare(mesh, setup, {}, expected.peak_bytes));
  test::expect_error(ErrorCode::out_of_budget, {"preparing needs"}, [&] { prepare(mesh, setup, {}, expected.peak_bytes - 1); });
  EXPECT_EQ(known_centres(*mesh, setup), known_centres(*mesh, hand.setups[1]));
}

/// What is told of a design holds for the points that turned handles carry on.
TEST(Composed, ErrorsAreToldOfTheChain) {
  const auto mesh = shared(test::bumpy_sheet(61, 31));
  RbfOptions loose;
  loose.solver = Solver::iterative;
  loose.tolerance = 1e-4;
  RbfOptions exact;
  exact.solver = Solver::ldlt;
  const auto system = prepare(mesh, two_methods(loose, exact));
  const auto truth = prepare(mesh, two_methods(exact, exact));
  for (const Design& design : population(6)) {
    const auto bound = system->bind({&design, 1}, EvaluationPath::direct, {});
    const double off = distance(system->evaluate({&design, 1}, EvaluationPath::direct)[0],
                                truth->evaluate({&design, 1}, EvaluationPath::direct)[0]);
    EXPECT_GE(bound->report(0).error, 0.5 * off);
    EXPECT_LE(bound->report(0).error, 1e-2);
  }
}

}  // namespace
}  // namespace deform::composed_test
