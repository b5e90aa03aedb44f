// SPDX-License-Identifier: GPL-3.0-or-later
// Which of many constraint points become centres: the result is that of all of them within a tolerance that is told.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <map>
#include <string>
#include <utility>

#include "core/base/reduction_error.h"
#include "core/base/vectors.h"
#include "core/deformers/methods.h"
#include "core/deformers/rbf/centres.h"
#include "core/deformers/system.h"
#include "core/mesh/ahmed.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/long_tests.h"

namespace deform::reduction_test {
namespace {

using test::box;
using test::bumpy_sheet;
using test::shared;

Mesh car(std::size_t points) {
  AhmedOptions options;
  options.target_points = points;
  return ahmed_body(options);
}

/// The example of the README.
deform::Setup car_setup() {
  deform::Setup setup;
  setup.handles = {{"slant", {Region::GroupName{"slant"}}},
                   {"roof", {Region::Intersection{{{Region::GroupName{"roof"}}, {Region::InBox{{0.4, -1, 0}, {0.6, 1, 1}}}}}}}};
  setup.fixed = {{Region::GroupName{"nose"}}, {Region::GroupName{"underbody"}}, {Region::GroupName{"stilts"}}};
  setup.variables = {{"roof_up", "roof", DesignVariable::Translate{{0, 0, 1}}},
                     {"slant_turn", "slant", DesignVariable::Rotate{{0, 1, 0}, {0.843, 0, 0.338}}}};
  return setup;
}

/// A sheet of [0, 2] x [0, 1] whose ends are a handle and fixed, with a gap between.
deform::Setup sheet_setup() {
  deform::Setup setup;
  setup.handles = {{"end", box({1.399, -9, -9}, {9, 9, 9})}};
  setup.fixed = {box({-9, -9, -9}, {0.601, 9, 9})};
  return setup;
}

deform::Setup with(deform::Setup setup, const RbfOptions& options) {
  setup.method = options;
  return setup;
}

RbfOptions all_centres() {
  RbfOptions options;
  options.reduction = CentreReduction::off;
  return options;
}

double largest_displacement(const Mesh& mesh, const Points& points) { return test::distance(points, mesh.points); }

/// Largest change of the angle between two triangles at an edge with an end on the border of the regions.
double roughness(const Mesh& mesh, const SelectedRegions& regions, const Points& deformed) {
  std::vector<char> held(mesh.point_count()), border(mesh.point_count());
  for (const auto& handle : regions.handles) {
    for (const PointId id : handle) held[id] = 1;
  }
  for (const PointId id : regions.fixed) held[id] = 1;
  std::map<std::pair<PointId, PointId>, std::vector<const PointId*>> edges;
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    const PointId* c = mesh.face_points.data() + 3 * f;
    const int count = held[c[0]] + held[c[1]] + held[c[2]];
    for (int k = 0; k < 3; ++k) {
      if (count % 3 != 0 && held[c[k]]) border[c[k]] = 1;
      edges[std::minmax(c[k], c[(k + 1) % 3])].push_back(c);
    }
  }
  const auto normal = [](const Points& x, const PointId* c) { return cross(x[c[1]] - x[c[0]], x[c[2]] - x[c[0]]); };
  const auto angle = [&](const Points& x, const PointId* a, const PointId* b) {
    const Vec3 m = normal(x, a), n = normal(x, b);
    return std::atan2(norm(cross(m, n)), dot(m, n));
  };
  double largest = 0;
  for (const auto& [edge, faces] : edges) {
    if (faces.size() != 2 || (!border[edge.first] && !border[edge.second])) continue;
    largest = std::max(largest, std::abs(angle(deformed, faces[0], faces[1]) - angle(mesh.points, faces[0], faces[1])));
  }
  return largest;
}

TEST(Reduction, HardlyChangesTheResultOfAllCentres) {
  const auto mesh = shared(car(10000));
  const SelectedRegions regions = validate(car_setup(), *mesh);
  for (const Kernel kernel : {Kernel::triharmonic, Kernel::biharmonic}) {
    RbfOptions few = {}, all = all_centres();
    few.kernel = all.kernel = kernel;
    const auto reduced = prepare(mesh, with(car_setup(), few)), full = prepare(mesh, with(car_setup(), all));
    const SystemInfo& info = reduced->info();
    EXPECT_TRUE(info.reduced);
    EXPECT_EQ(full->info().centres, full->info().constraint_points);
    EXPECT_LT(2 * info.centres, info.constraint_points);
    EXPECT_GT(info.reduction_misfit, 0);
    EXPECT_LE(info.reduction_misfit, info.reduction_tolerance);
    EXPECT_EQ(info.reduction_tolerance, default_reduction_tolerance(kernel));
    for (const std::vector<double>& variables : {std::vector<double>{0.04, 0}, {0, 0.1}, {0.03, -0.1}}) {
      const Design design{variables, {}};
      const Points got = reduced->evaluate(design), expected = full->evaluate(design);
      const double moved = largest_displacement(*mesh, expected);
      EXPECT_LT(test::distance(got, expected), 0.01 * moved) << properties(kernel).name;
      const double estimated =
          info.reduction_error * reduced->bind({&design, 1}, EvaluationPath::automatic, {})->report(0).prescribed_displacement;
      EXPECT_LT(test::distance(got, expected), 2 * estimated) << properties(kernel).name;
      EXPECT_LT(info.reduction_error, doubtful_reduction);
      EXPECT_LT(roughness(*mesh, regions, got), 1.02 * roughness(*mesh, regions, expected)) << properties(kernel).name;
    }
  }
}

// Rings miss the points far away, which the estimate counts. Where all are centres there is nothing to estimate.
TEST(Reduction, RingsSayHowFarTheyAreFromAllCentres) {
  const auto mesh = shared(car(5000));
  RbfOptions rings = {}, all = all_centres();
  rings.reduction = CentreReduction::rings;
  const auto reduced = prepare(mesh, with(car_setup(), rings)), full = prepare(mesh, with(car_setup(), all));
  EXPECT_EQ(full->info().reduction_error, 0);
  const SystemInfo& info = reduced->info();
  EXPECT_GT(info.reduction_error, doubtful_reduction);
  EXPECT_EQ(info.reduction_tolerance, 0);
  const Design design{{0.03, -0.1}, {}};
  const auto bound = reduced->bind({&design, 1}, EvaluationPath::automatic, {});
  const double off = test::distance(reduced->evaluate(design), full->evaluate(design));
  const double estimated = info.reduction_error * bound->report(0).prescribed_displacement;
  EXPECT_LT(off, 2 * estimated);
  EXPECT_GT(off, estimated / 20);
}

// Refined, the sheet keeps its regions; what moves between them must not depend on how fine it is.
TEST(Reduction, ResultSettlesAsTheMeshIsRefined) {
  Affine lift = identity_affine;
  lift[2] = 0.1;
  lift[11] = 0.3;
  const Design design{{}, {{0, lift}}};
  Points before;
  double change = 1;
  RbfOptions options;
  options.reduction_tolerance = 3e-5;  // for less than what still changes with the mesh
  for (const std::size_t k : {1u, 2u, 4u}) {
    const std::size_t columns = 80 * k + 1, rows = 40 * k + 1;
    const auto mesh = shared(bumpy_sheet(columns, rows));
    const auto system = prepare(mesh, with(sheet_setup(), options));
    EXPECT_EQ(system->info().reduced, k > 1) << system->info().centres;
    const Points deformed = system->evaluate(design);
    Points common;
    for (std::size_t j = 0; j < rows; j += k) {
      for (std::size_t i = 0; i < columns; i += k) common.push_back(deformed[i + columns * j]);
    }
    if (!before.empty()) {
      const double now = test::distance(common, before) / largest_displacement(*mesh, deformed);
      EXPECT_LT(now, 0.7 * change);
      change = now;
    }
    before = common;
  }
  EXPECT_LT(change, 0.003);
}

TEST(Reduction, TighterTolerancesTakeMoreCentresAndMissLess) {
  const auto mesh = shared(bumpy_sheet(161, 81));
  std::size_t centres = 0;
  for (const double tolerance : {1e-2, 1e-3, 1e-4}) {
    RbfOptions options;
    options.reduction_tolerance = tolerance;
    const SystemInfo info = prepare(mesh, with(sheet_setup(), options))->info();
    EXPECT_LE(info.reduction_misfit, tolerance);
    EXPECT_GE(info.centres, centres);
    centres = info.centres;
  }
}

// The choice is one of places in proportion: units and the position of the model do not matter.
TEST(Reduction, DoesNotDependOnUnits) {
  const Mesh metres = bumpy_sheet(161, 81);
  Mesh other = metres;
  for (Vec3& x : other.points) x = {1024 * x[0], 1024 * x[1], 1024 * x[2]};
  deform::Setup setup = sheet_setup();
  setup.handles[0].region = box({1024 * 1.399, -1e9, -1e9}, {1e9, 1e9, 1e9});
  setup.fixed[0] = box({-1e9, -1e9, -1e9}, {1024 * 0.601, 1e9, 1e9});
  const SystemInfo a = prepare(shared(metres), sheet_setup())->info(), b = prepare(shared(other), setup)->info();
  EXPECT_EQ(a.centres, b.centres);
  EXPECT_NEAR(a.reduction_misfit, b.reduction_misfit, 1e-6 * a.reduction_tolerance);
}

TEST(Reduction, TakesAllOfFewPoints) {
  const auto mesh = shared(bumpy_sheet(121, 61));
  const SystemInfo info = prepare(mesh, sheet_setup())->info();
  EXPECT_LT(info.constraint_points, 5000u);
  EXPECT_FALSE(info.reduced);
  EXPECT_EQ(info.centres, info.constraint_points);
  EXPECT_EQ(info.reduction_tolerance, 0);
}

// Half of a sheet behaves as the whole one, although centres are chosen in the half.
TEST(Reduction, OfAHalfModelIsThatOfTheWhole) {
  constexpr std::size_t columns = 161, rows = 81;
  Mesh half = bumpy_sheet(columns, rows), whole = half;
  for (std::size_t i = 0; i < half.point_count(); ++i) {
    if (i >= columns) whole.points.push_back({half.points[i][0], -half.points[i][1], half.points[i][2]});
  }
  deform::Setup of_half = sheet_setup();
  of_half.symmetry = {{SymmetryPlane::Plane{{0, 0, 0}, {0, 1, 0}}}};
  const auto system = prepare(shared(half), of_half);
  EXPECT_TRUE(system->info().reduced);
  EXPECT_LE(system->info().reduction_misfit, system->info().reduction_tolerance);
  const double c = std::cos(0.3), s = std::sin(0.3);
  const Affine motion{c, 0, s, 0.1, 0, 1.2, 0, 0, -s, 0, c, 0.4};
  const Design design{{}, {{0, motion}}};
  const Points got = system->evaluate(design);
  Points expected = prepare(shared(whole), sheet_setup())->evaluate(design);
  expected.resize(half.point_count());
  EXPECT_LT(test::distance(got, expected), 0.005 * largest_displacement(half, got));
}

// Where the joins alone have thousands of points, others are looked for with fewer; all at the joins are centres in the end.
TEST(Reduction, ManyPointsAtJoinsStayCentresAndResultsDoNotDependOnThem) {
  constexpr std::size_t columns = 81, rows = 41, finer = 52;
  const Mesh coarse = bumpy_sheet(columns, rows), fine = bumpy_sheet(columns, finer * (rows - 1) + 1);
  const ConstraintPoints points = constraint_points(fine, validate(sheet_setup(), fine));
  RbfOptions options;
  options.kernel = Kernel::triharmonic;
  RbfCentres chosen = choose_centres(fine, points, 1, options);
  const std::vector<PointId> first = chosen.ids, coarser = chosen.coarse;
  EXPECT_GT(first.size(), 4000u);
  ASSERT_FALSE(coarser.empty());
  EXPECT_LE(coarser.size(), 1500u);
  std::vector<PointId> expected;
  std::set_union(first.begin(), first.end(), coarser.begin(), coarser.end(), std::back_inserter(expected));
  join_coarse(points, chosen);
  EXPECT_EQ(chosen.ids, expected);
  for (const PointId id : points.deformable) {
    for (const PointId other : {id - 1, id + 1}) {
      if (points.region_of[other] == deformable_region) continue;
      EXPECT_TRUE(std::binary_search(first.begin(), first.end(), other)) << other;
    }
  }

  Affine lift = identity_affine;
  lift[2] = 0.1;
  lift[11] = 0.3;
  const Design design{{}, {{0, lift}}};
  const auto system = prepare(shared(fine), sheet_setup());
  const SystemInfo& info = system->info();
  EXPECT_TRUE(info.reduced);
  EXPECT_GE(info.centres, first.size());
  EXPECT_LE(info.reduction_misfit, info.reduction_tolerance);
  const auto bound = system->bind({&design, 1}, EvaluationPath::automatic, {});
  EXPECT_LT(bound->report(0).interpolation_residual, 1e-3 / static_cast<double>(finer * rows));  // of the edges at the joins
  const Points got = system->evaluate(design),
               all = prepare(shared(coarse), with(sheet_setup(), all_centres()))->evaluate(design);
  Points common;
  for (std::size_t j = 0; j < rows; ++j) {
    for (std::size_t i = 0; i < columns; ++i) common.push_back(got[i + columns * finer * j]);
  }
  EXPECT_LT(test::distance(common, all), 0.01 * largest_displacement(fine, got));
}

TEST(Reduction, BoundIsToldBefore) {
  const Mesh mesh = bumpy_sheet(161, 81);
  const Estimate expected = estimate(mesh, sheet_setup());
  const SystemInfo info = prepare(shared(mesh), sheet_setup())->info();
  EXPECT_GE(expected.centres, info.centres);
  EXPECT_LE(expected.centres, 8000u);
  // What was reached is said in numbers that are those of the fields.
  char text[300];
  std::snprintf(text, sizeof text,
                "%zu of %zu constraint points are centres: motions of the handles are missed at the others by at most %.1e of "
                "their largest displacement, and points may be %.1e of it from where they would be if all were centres.",
                info.centres, info.constraint_points, info.reduction_misfit, info.reduction_error);
  EXPECT_NE(std::find(info.notes.begin(), info.notes.end(), text), info.notes.end()) << text;
  EXPECT_GE(expected.factor_bytes, info.factor_bytes);
  EXPECT_GE(expected.resident_bytes, info.bytes);
  EXPECT_GE(expected.peak_bytes, expected.resident_bytes);
  EXPECT_FALSE(known_centres(mesh, sheet_setup()).has_value());
  const auto said = std::find_if(expected.notes.begin(), expected.notes.end(),
                                 [](const std::string& note) { return note.find("not known before") != std::string::npos; });
  EXPECT_NE(said, expected.notes.end());
}

// A handle that touches a fixed region tears the field there: it takes more centres.
TEST(Reduction, MeetsAHandleThatTouchesAFixedRegion) {
  const auto mesh = shared(bumpy_sheet(201, 81));
  deform::Setup setup = sheet_setup();
  setup.handles[0].region = box({0.602, -9, -9}, {1.2, 9, 9});
  const SystemInfo info = prepare(mesh, setup)->info();
  EXPECT_TRUE(info.reduced);
  EXPECT_LE(info.centres, estimate(*mesh, setup).centres);
  EXPECT_LE(info.reduction_misfit, info.reduction_tolerance);
}

// Every other column moves and those between stay: there may not be as many centres as that takes, and that is told.
TEST(Reduction, TellsThatItsToleranceIsNotMet) {
  constexpr std::size_t columns = 201;
  const auto mesh = shared(bumpy_sheet(columns, 81));
  deform::Setup setup;
  setup.handles = {{"odd", {Region::Ids{}}}};
  setup.fixed = {{Region::Ids{}}};
  for (PointId id = 0; id < mesh->point_count(); ++id) {
    const std::size_t column = id % columns;
    if (column < 30) continue;
    std::get<Region::Ids>(column % 2 == 1 ? setup.handles[0].region.kind : setup.fixed[0].kind).ids.push_back(id);
  }
  EXPECT_EQ(estimate(*mesh, setup).centres, 8000u);
  if (!test::long_tests()) return;  // preparing so many takes 10 s
  const SystemInfo info = prepare(mesh, setup)->info();
  EXPECT_LE(info.centres, 8000u);
  EXPECT_GT(info.reduction_misfit, info.reduction_tolerance);
  EXPECT_NE(info.notes[0].find("not to the reduction tolerance"), std::string::npos) << info.notes[0];
}

TEST(Reduction, LeavesKernelsWithAShapeAlone) {
  const Mesh mesh = bumpy_sheet(161, 81);
  RbfOptions options;
  options.kernel = Kernel::gaussian;
  const Estimate expected = estimate(mesh, with(sheet_setup(), options));
  EXPECT_EQ(expected.centres, expected.constraint_points);
  ASSERT_FALSE(expected.notes.empty());
  EXPECT_NE(expected.notes[0].find("shape"), std::string::npos);
}

/// The points of a block of n^3, the layers thinner towards z = 0.
Mesh block(std::size_t n) {
  Mesh mesh;
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t j = 0; j < n; ++j) {
      for (std::size_t i = 0; i < n; ++i) {
        const double width = 1 / static_cast<double>(n - 1), z = width * static_cast<double>(k);
        mesh.points.push_back({width * static_cast<double>(i), width * static_cast<double>(j), z * z});
      }
    }
  }
  return mesh;
}

// Layers of cells on a wall are as thin as the distance of its points from deformable ones: all points of the wall are needed.
TEST(Reduction, KeepsTheWallsOfVolumes) {
  const Mesh mesh = block(33);
  deform::Setup setup;
  setup.handles = {{"floor", box({-1, -1, -1}, {2, 2, 0})}};
  setup.fixed = {box({-1, -1, 1}, {2, 2, 2}), box({-1, -1, 1e-9}, {0, 2, 2}), box({1, -1, 1e-9}, {2, 2, 2}),
                 box({-1, -1, 1e-9}, {2, 0, 2}), box({-1, 1, 1e-9}, {2, 2, 2})};
  const Estimate expected = estimate(mesh, setup);
  EXPECT_GT(expected.constraint_points, 5000u);
  const SelectedRegions regions = validate(setup, mesh);
  const RbfCentres chosen = choose_centres(mesh, constraint_points(mesh, regions), 1, {});
  // All points of the floor but those that lie beside fixed walls only.
  std::size_t inside = 0;
  for (const PointId id : regions.handles[0]) {
    const Vec3& x = mesh.points[id];
    if (x[0] < 0.01 || x[0] > 0.99 || x[1] < 0.01 || x[1] > 0.99) continue;
    ++inside;
    EXPECT_TRUE(std::binary_search(chosen.ids.begin(), chosen.ids.end(), id)) << id;
  }
  EXPECT_EQ(inside, 31U * 31U);
}

/// The worst of more points than are compared count, wherever they stand; each new centre is apart from those before.
TEST(Reduction, TheMostMissedOfManyAreTheWorst) {
  Mesh mesh;
  std::vector<PointId> ids;
  std::vector<double> misfits;
  constexpr std::size_t count = 25000;
  for (std::size_t i = 0; i < count; ++i) {
    const auto t = static_cast<double>(i);
    mesh.points.push_back({std::fmod(0.618 * t, 1.0), std::fmod(0.413 * t, 1.0), std::fmod(0.277 * t, 1.0)});
    ids.push_back(static_cast<PointId>(i));
    misfits.push_back(1e-3 * (1 + t / count));  // the last ones most
  }
  const std::vector<PointId> centres{0, 1, 2};
  const auto near = [&](PointId a, PointId b) { return test::distance(mesh.points[a], mesh.points[b]); };
  const std::vector<PointId> got = most_missed(mesh, centres, ids, misfits, 1e-3, 40);
  ASSERT_EQ(got.size(), 40u);
  EXPECT_TRUE(std::is_sorted(got.begin(), got.end()));
  // By hand, from the worst on.
  std::vector<PointId> expected;
  for (std::size_t i = count; i-- > 0 && expected.size() < 40;) {
    const auto id = static_cast<PointId>(i);
    double clear = HUGE_VAL;
    for (const PointId c : centres) clear = std::min(clear, near(id, c));
    if (clear > 0 &&
        std::none_of(expected.begin(), expected.end(), [&](PointId other) { return near(id, other) < std::sqrt(0.5) * clear; }))
      expected.push_back(id);
  }
  std::sort(expected.begin(), expected.end());
  EXPECT_EQ(got, expected);
  EXPECT_TRUE(most_missed(mesh, centres, ids, misfits, 1, 40).empty()) << "all are within half of the tolerance";
}

}  // namespace
}  // namespace deform::reduction_test
