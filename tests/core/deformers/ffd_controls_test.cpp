// SPDX-License-Identifier: GPL-3.0-or-later
// The method ffd with control CONTROLS: handles move control points (thesis 3.2). Splines of the tests are written here.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "core/base/vectors.h"
#include "core/deformers/energy/spaces/model_lattice.h"
#include "core/deformers/splitting.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/block_meshes.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/deformers/lattice_by_hand.h"
#include "tests/support/expect_error.h"

namespace deform::ffd_controls_test {
namespace {

using test::shared;
using Counts = std::array<std::size_t, 3>;

constexpr std::array<LatticeBasis, 3> bases{LatticeBasis::uniform_cubic, LatticeBasis::clamped_cubic, LatticeBasis::bernstein};
const LatticeFrame tilted{{-0.2, -0.4, -0.5}, {{{2.6, 0.3, 0.1}, {-0.2, 1.8, 0.2}, {0.1, -0.2, 1.3}}}};

Region range(std::optional<Region::LatticeRange::Range> i, std::optional<Region::LatticeRange::Range> j = std::nullopt,
             std::optional<Region::LatticeRange::Range> k = std::nullopt) {
  return {Region::LatticeRange{{i, j, k}}};
}
Region ids(std::vector<std::uint32_t> list) { return {Region::ControlIds{std::move(list)}}; }

FfdOptions by_controls(LatticeBasis basis = LatticeBasis::uniform_cubic, const Counts& points = {7, 6, 4}) {
  FfdOptions options;
  options.control = FfdControl::controls;
  options.lattice = {tilted, points, basis, {}};
  return options;
}

/// Two handles with the variables of test::setup_with_variables(): the far end, and some single control points.
deform::Setup control_setup(const FfdOptions& options) {
  deform::Setup setup = test::setup_with_variables();
  setup.method = options;
  setup.handles[0].region = range({{5, 6}}, std::nullopt, {{1, 3}});
  setup.handles[1].region = {Region::Union{{ids({66, 3, 67}), range({{2, 3}}, {{2, 2}}, {{1, 1}})}}};
  setup.fixed = {range({{0, 1}})};
  return setup;
}

const Design some_design{{0.1, 0.8, 0.2, -0.6}, {}};

// ---- the definition ----

using test::local;
using test::rest_places;
using test::triple_sum;

/// Control points of the handles of control_setup(), by their indices.
bool in_end(std::size_t p) { return p % 7 >= 5 && p / 42 >= 1; }
bool in_middle(std::size_t p) {
  return p == 66 || p == 3 || p == 67 || (p % 7 >= 2 && p % 7 <= 3 && p / 7 % 6 == 2 && p / 42 == 1);
}

std::vector<Vec3> displacements(const std::vector<Vec3>& places, const std::vector<Affine>& motions) {
  std::vector<Vec3> result(places.size());
  for (std::size_t p = 0; p < places.size(); ++p) {
    if (in_end(p)) result[p] = transformed(motions[0], places[p]) - places[p];
    if (in_middle(p)) result[p] = transformed(motions[1], places[p]) - places[p];
  }
  return result;
}

TEST(FfdByControls, IsTheTripleSum) {
  const auto mesh = shared(test::bumpy_sheet(23, 12));
  for (const LatticeBasis basis : bases) {
    const FfdOptions options = by_controls(basis);
    const deform::Setup setup = control_setup(options);
    const auto system = prepare(mesh, setup);
    EXPECT_EQ(system->info().functions, 7u * 6 * 4);
    EXPECT_EQ(system->info().handle_points, 2u * 6 * 3 + 5);
    EXPECT_EQ(system->info().fixed_points, 2u * 6 * 4);
    const std::vector<Vec3> places = rest_places(options.lattice);
    const std::vector<Vec3> moved = displacements(places, handle_motions(setup, some_design.variables));
    double largest = 0;
    for (const Vec3& u : moved) largest = std::max(largest, norm(u));
    for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
      const Points got = system->evaluate({&some_design, 1}, path)[0];
      double farthest = 0;
      for (std::size_t i = 0; i < got.size(); ++i) {
        const Vec3 u = triple_sum(options.lattice, moved, local(tilted, mesh->points[i]));
        EXPECT_LT(distance(got[i], mesh->points[i] + u), 2e-13);
        farthest = std::max(farthest, norm(u));
      }
      EXPECT_GT(farthest, 0.1);
      const DesignReport report = system->bind({&some_design, 1}, path, {})->report(0);
      EXPECT_NEAR(report.control_displacement, largest, 1e-12);
      EXPECT_LT(report.error, 1e-11);
      EXPECT_TRUE(report.warnings.empty());
    }
  }
}

TEST(FfdByControls, TakesADisplacementPerControlPoint) {
  const auto mesh = shared(test::bumpy_sheet(23, 12));
  const FfdOptions options = by_controls();
  deform::Setup setup = control_setup(options);
  const std::vector<Vec3> given{{0.1, 0, 0}, {0, 0.2, 0}, {0, 0, -0.1}, {0.1, 0.1, 0}, {0, 0.1, 0.3}};  // of 3, 58, 59, 66, 67
  std::vector<Vec3> moved(7 * 6 * 4);
  const std::array<std::size_t, 5> numbers{3, 58, 59, 66, 67};
  for (std::size_t i = 0; i < 5; ++i) moved[numbers[i]] = given[i];
  const Points got = prepare(mesh, setup)->evaluate({{}, {{1, given}}});
  for (std::size_t i = 0; i < got.size(); ++i) {
    const Vec3 u = triple_sum(options.lattice, moved, local(tilted, mesh->points[i]));
    EXPECT_LT(distance(got[i], mesh->points[i] + u), 1e-13);
  }
}

TEST(FfdByControls, AllControlPointsTogetherMoveAffinely) {
  const auto mesh = shared(test::bumpy_sheet(23, 12));
  const Affine motion{1.1, -0.2, 0.3, 0.1, 0.25, 0.9, 0.1, -0.05, -0.1, 0.2, 1.3, 0.2};
  for (const LatticeBasis basis : bases) {
    deform::Setup setup;
    setup.method = by_controls(basis);
    setup.handles = {{"all", range(std::nullopt)}};
    const auto system = prepare(mesh, setup);
    const Design design{{}, {{0, motion}}};
    for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
      const Points got = system->evaluate({&design, 1}, path)[0];
      for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(got[i], transformed(motion, mesh->points[i])), 1e-13);
    }
  }
}

/// A control point moves what lies within its four spans along each axis, and nothing else.
TEST(FfdByControls, OneControlPointMovesFourSpans) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  const Counts points{9, 8, 5};
  deform::Setup setup;
  setup.method = by_controls(LatticeBasis::uniform_cubic, points);
  setup.handles = {{"one", ids({4 + 9 * (3 + 8 * 2)})}};
  const Points got = prepare(mesh, setup)->evaluate({{}, {{0, Affine{1, 0, 0, 0.3, 0, 1, 0, 0, 0, 0, 1, 0}}}});
  const Counts at{4, 3, 2};
  std::size_t moved = 0;
  for (std::size_t i = 0; i < got.size(); ++i) {
    const Vec3 u = local(tilted, mesh->points[i]);
    bool within = true;
    for (std::size_t k = 0; k < 3; ++k) {
      const double spans = static_cast<double>(points[k] - 3), first = static_cast<double>(at[k]) - 3;
      within = within && u[k] * spans > first && u[k] * spans < first + 4;
    }
    EXPECT_EQ(got[i] != mesh->points[i], within) << i;
    moved += within ? 1 : 0;
  }
  EXPECT_GT(moved, 100u);
  EXPECT_LT(moved, got.size());
}

TEST(FfdByControls, JacobianProductsAndPopulations) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    FfdOptions options = by_controls();
    options.basis = basis;
    const auto system = prepare(mesh, control_setup(options));
    EXPECT_EQ(system->info().basis_fields, basis == BasisMode::always ? 8u : 0u);
    test::check_jacobians(*system, 1e-14, 1e-8);
  }
  test::check_population(*prepare(mesh, control_setup(by_controls())), 5);
}

TEST(FfdByControls, MoreDesignsThanShareTheWeightsOfAPoint) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  const auto system = prepare(mesh, control_setup(by_controls()));
  std::vector<Design> designs;
  for (int i = 0; i < 35; ++i) designs.push_back({{0.02 * i, 0.1, -0.01 * i, 0.3}, {}});
  std::vector<Points> together(designs.size(), Points(mesh->point_count()));
  std::vector<Vec3*> out;
  for (Points& points : together) out.push_back(points.data());
  system->bind(designs, EvaluationPath::direct, {})->evaluate(0, mesh->point_count(), 0, out);
  for (std::size_t i = 0; i < designs.size(); ++i) {
    EXPECT_TRUE(system->evaluate({&designs[i], 1}, EvaluationPath::direct)[0] == together[i]) << i;
  }
}

TEST(FfdByControls, BasisToATolerance) {
  const auto mesh = shared(test::bumpy_sheet(91, 46));
  FfdOptions options = by_controls();
  options.basis = BasisMode::always;
  const auto exact = prepare(mesh, control_setup(options));
  options.basis_tolerance = 1e-6;
  const auto rounded = prepare(mesh, control_setup(options));
  EXPECT_LT(rounded->info().basis_bytes, exact->info().basis_bytes);
  const double away = test::distance(exact->evaluate(some_design), rounded->evaluate(some_design));
  EXPECT_LE(away, rounded->bind({&some_design, 1}, EvaluationPath::basis, {})->report(0).error);
  EXPECT_GT(away, 0);
}

// ---- where the lattice ends ----

/// Twelve by five points of the sheet are in a lattice over its middle.
struct Cut {
  std::shared_ptr<const Mesh> mesh = shared(test::bumpy_sheet(41, 21));
  LatticeFrame frame{{0.52, -0.1, -0.5}, {{{0.96, 0, 0}, {0, 1.2, 0}, {0, 0, 1}}}};
  deform::Setup setup;

  explicit Cut(const Region& region) {
    FfdOptions options;
    options.control = FfdControl::controls;
    options.lattice = {frame, {10, 6, 4}, LatticeBasis::uniform_cubic, {}};
    setup.method = options;
    setup.handles = {{"h", region}};
  }
  bool inside(PointId id) const { return mesh->points[id][0] >= 0.52 && mesh->points[id][0] <= 0.52 + 0.96; }
};

const Design lifted{{}, {{0, Affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.2}}}};

TEST(FfdByControls, PointsOutsideStayAndTornEdgesAreCounted) {
  const Cut cut(range({{0, 3}}));
  const auto system = prepare(cut.mesh, cut.setup);
  const Points got = system->evaluate(lifted);
  std::size_t outside = 0;
  for (PointId id = 0; id < got.size(); ++id) {
    if (cut.inside(id)) continue;
    ++outside;
    EXPECT_EQ(got[id], cut.mesh->points[id]);
  }
  // 21 rows of points are cut on either side; the handle holds what is next to the left one, where its layers add up to 1.
  EXPECT_THAT(system->info().notes,
              testing::Contains(testing::AllOf(testing::HasSubstr(std::to_string(outside) + " points lie outside of the lattice"),
                                               testing::HasSubstr("42 edges cross its boundary"))));
  const auto evaluation = system->bind({&lifted, 1}, EvaluationPath::automatic, {});
  EXPECT_EQ(evaluation->report(0).torn_edges, 21u);
  ASSERT_EQ(evaluation->report(0).warnings.size(), 1u);
  EXPECT_THAT(evaluation->report(0).warnings[0],
              testing::AllOf(testing::HasSubstr(std::to_string(outside) + " points outside"),
                             testing::HasSubstr("of the 42 edges"), testing::HasSubstr(" 21 are torn there by up to 2.0e-01")));
}

// Edges of cells are cut where there are no faces, too.
TEST(FfdByControls, EdgesOfCellsAcrossTheBoundaryAreCounted) {
  test::Cube block = test::cube(4);
  block.mesh.face_sizes.clear();
  block.mesh.face_points.clear();
  block.mesh.elements = std::make_shared<const Elements>(block.elements);
  FfdOptions options;
  options.lattice.points = {5, 5, 5};
  options.lattice.frame = LatticeFrame{{-0.5, -0.5, -0.5}, {{{1.1, 0, 0}, {0, 2, 0}, {0, 0, 2}}}};  // to x = 0.6
  const ModelLattice made = control_lattice(block.mesh, options.lattice, {});
  EXPECT_EQ(made.outside.size(), 2u * 25u);
  EXPECT_THAT(made.notes, testing::Contains(testing::HasSubstr("25 edges cross its boundary")));
  const std::vector<Vec3> crossings = boundary_crossings(block.mesh, options.lattice, made);
  ASSERT_EQ(crossings.size(), 25u);
  for (const Vec3& u : crossings) EXPECT_NEAR(u[0], 1, 1e-12);
}

// In a moved lattice the crossing is taken for the nearest place on the boundary of its cube of coordinates.
TEST(FfdByControls, CrossingsOfAMovedLatticeAreBesideThePointsInside) {
  const Mesh mesh = test::bumpy_sheet(41, 21);
  LatticeOptions options;
  options.points = {6, 5, 5};
  options.frame = LatticeFrame{{0.31, 0.22, -1}, {{{1.3, 0, 0}, {0, 0.55, 0}, {0, 0, 2}}}};
  const Lattice lattice = lattice_around(options, bounding_box(mesh.points));
  options.control_points = lattice.control_points();
  const ModelLattice made = control_lattice(mesh, options, {});
  ASSERT_FALSE(made.outside.empty());
  const std::vector<Vec3> crossings = boundary_crossings(mesh, options, made);
  ASSERT_GT(crossings.size(), 50u);
  for (const Vec3& u : crossings) {
    // On one side, and no point inside of an edge that is cut is farther from it than from another side.
    int on = 0;
    for (std::size_t k = 0; k < 3; ++k) on += u[k] == 0 || u[k] == 1 ? 1 : 0;
    EXPECT_EQ(on, 1);
    double nearest = 1;
    for (PointId id = 0; id < mesh.points.size(); ++id) {
      if (made.rows->is_outside(id)) continue;
      const Vec3& from = made.rows->coordinates(id);
      double away = 0, least = 1;
      for (std::size_t k = 0; k < 3; ++k) {
        away = std::max(away, std::abs(from[k] - u[k]));
        least = std::min({least, from[k], 1 - from[k]});
      }
      if (away <= least + 1e-12) nearest = std::min(nearest, away);
    }
    EXPECT_LT(nearest, 0.1) << "of a point whose nearest side this is";
  }
}

TEST(FfdByControls, LayersThatStayLeaveNothingTorn) {
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const Cut still(range({{3, 6}}));
    EXPECT_TRUE(prepare(still.mesh, still.setup)->bind({&lifted, 1}, path, {})->report(0).warnings.empty());
    EXPECT_EQ(prepare(still.mesh, still.setup)->bind({&lifted, 1}, path, {})->report(0).torn_edges, 0u);
    const Cut torn(range({{2, 6}}));  // the third layer still reaches the boundary
    EXPECT_EQ(prepare(torn.mesh, torn.setup)->bind({&lifted, 1}, path, {})->report(0).warnings.size(), 1u);
  }
}

TEST(FfdByControls, NamesHandlesThatMoveNothing) {
  const auto mesh = shared(test::bumpy_sheet(23, 12));
  deform::Setup setup = control_setup(by_controls(LatticeBasis::uniform_cubic, {12, 9, 9}));
  setup.handles[0].region = range({{11, 11}}, {{0, 0}}, {{8, 8}});
  setup.handles[1].region = range({{5, 6}});
  const auto system = prepare(mesh, setup);
  EXPECT_THAT(system->info().notes, testing::Contains(testing::HasSubstr("handle \"end\", which moves nothing")));
  EXPECT_EQ(system->evaluate({{0.3, 0, 0, 0}, {}}), mesh->points);
}

TEST(FfdByControls, EstimatesBoundWhatIsTaken) {
  for (const std::size_t columns : {31u, 91u}) {
    const auto mesh = shared(test::bumpy_sheet(columns, columns / 2 + 1));
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      FfdOptions options = by_controls();
      options.basis = basis;
      test::expect_bounds(estimate(*mesh, control_setup(options)), prepare(mesh, control_setup(options))->info());
    }
  }
}

// ---- lattices that were moved ----

std::vector<Vec3> bent_places(const LatticeOptions& lattice) {
  std::vector<Vec3> places = rest_places(lattice);
  for (Vec3& c : places) c = c + Vec3{0.1 * c[1] * c[1], 0.08 * std::sin(2 * c[0]), 0.15 * c[0] * c[0]};
  return places;
}

/// Points that are placed by their local coordinates, which the system has to find again.
TEST(FfdByControls, StartsFromAMovedLattice) {
  for (const LatticeBasis basis : bases) {
    FfdOptions options = by_controls(basis);
    options.lattice.control_points = bent_places(options.lattice);
    Mesh placed;
    std::vector<Vec3> u;
    for (std::size_t i = 0; i < 60; ++i) {
      const double t = static_cast<double>(i);
      u.push_back({std::fmod(0.618 * t, 1.0), std::fmod(0.413 * t + 0.1, 1.0), std::fmod(0.277 * t + 0.2, 1.0)});
      placed.points.push_back(triple_sum(options.lattice, options.lattice.control_points, u.back()));
    }
    placed.points.push_back({9, 9, 9});  // outside
    const auto mesh = shared(std::move(placed));
    const deform::Setup setup = control_setup(options);
    const std::vector<Vec3> moved = displacements(options.lattice.control_points, handle_motions(setup, some_design.variables));
    const Points got = prepare(mesh, setup)->evaluate(some_design);
    for (std::size_t i = 0; i < u.size(); ++i) {
      EXPECT_LT(distance(got[i], mesh->points[i] + triple_sum(options.lattice, moved, u[i])), 1e-11);
    }
    EXPECT_EQ(got.back(), mesh->points.back());
  }
}

TEST(FfdByControls, CoincidentControlPointsMayPart) {
  const auto mesh = shared(test::bumpy_sheet(11, 6));
  FfdOptions options = by_controls();
  options.lattice.control_points = rest_places(options.lattice);
  const std::size_t p = 2 + 7 * (2 + 6 * 1);
  options.lattice.control_points[p] = options.lattice.control_points[p + 1];
  deform::Setup setup;
  setup.method = options;
  setup.handles = {{"one", ids({static_cast<std::uint32_t>(p)})}, {"other", ids({static_cast<std::uint32_t>(p + 1)})}};
  const auto up = [](double z) { return Affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, z}; };
  const auto system = prepare(mesh, setup);
  const Points both = system->evaluate({{}, {{0, up(0.2)}, {1, up(-0.1)}}});
  const Points one = system->evaluate({{}, {{0, up(0.2)}}}), other = system->evaluate({{}, {{1, up(-0.1)}}});
  double largest = 0;
  for (std::size_t i = 0; i < both.size(); ++i) {
    EXPECT_NEAR(both[i][2], one[i][2] + other[i][2] - mesh->points[i][2], 1e-14);
    largest = std::max(largest, std::abs(both[i][2] - mesh->points[i][2]));
  }
  EXPECT_GT(largest, 1e-3);
}

TEST(FfdByMesh, StartsFromAMovedLattice) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  FfdOptions options = by_controls();
  options.control = FfdControl::mesh;
  options.clamp = 1e-6;
  options.lattice.frame = LatticeFrame{{-0.6, -0.8, -0.8}, {{{3.2, 0, 0}, {0, 2.6, 0}, {0, 0, 2.2}}}};
  deform::Setup setup = test::sheet_setup();
  setup.method = options;
  const Design design{{}, {{0, test::turn_and_shift()}}};
  const Points at_rest = prepare(mesh, setup)->evaluate(design);
  options.lattice.control_points = rest_places(options.lattice);
  setup.method = options;
  EXPECT_LT(test::distance(prepare(mesh, setup)->evaluate(design), at_rest), 1e-7);
  options.lattice.control_points = bent_places(options.lattice);
  setup.method = options;
  EXPECT_GT(test::distance(prepare(mesh, setup)->evaluate(design), at_rest), 1e-4) << "another lattice, another deformation";
}

// ---- what is refused ----

TEST(FfdByControls, RefusesWhatIsWrongWithRegions) {
  const Mesh mesh = test::bumpy_sheet(11, 6);
  const auto refused = [&](const std::vector<const char*>& parts, const auto& spoil) {
    deform::Setup setup = control_setup(by_controls());
    spoil(setup);
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { validate(setup, mesh); });
  };
  using Setup = deform::Setup;
  const auto options = [](Setup& s) -> FfdOptions& { return std::get<FfdOptions>(s.method); };
  refused({"handle \"end\"", "points of the mesh", "CONTROLS"}, [](Setup& s) {
    s.handles[0].region = test::box({0, 0, 0}, {1, 1, 1});
  });
  refused({"fixed[0]", "points of the mesh", "CONTROLS"}, [](Setup& s) { s.fixed = {{Region::All{}}}; });
  refused({"handle \"end\"", "points of the mesh"}, [](Setup& s) { s.handles[0].region = {Region::Grow{{range({{0, 1}})}, 1}}; });
  refused({"handle \"end\"", "lattice.i", "[5, 7]", "7 control points"}, [](Setup& s) { s.handles[0].region = range({{5, 7}}); });
  refused({"handle \"end\"", "lattice.k", "[2, 1]"}, [](Setup& s) { s.handles[0].region = range({}, {}, {{2, 1}}); });
  refused({"handle \"middle\"", "control.ids", "168", "control point"}, [](Setup& s) { s.handles[1].region = ids({3, 168}); });
  refused({"handle \"middle\"", "contains no control point"}, [](Setup& s) {
    s.handles[1].region = {Region::Intersection{{ids({3}), ids({4})}}};
  });
  refused({"fixed[0]", "overlaps handle \"end\"", "3 common control points, the first is control point"}, [](Setup& s) {
    s.fixed = {range({{6, 6}}, {{5, 5}})};
  });
  refused({"constraints", "CONTROLS"}, [](Setup& s) { s.constraints.push_back({"flat", {{Region::All{}}}, Planar{}}); });
  refused({"control_points", "ENERGY"}, [&](Setup& s) {
    s = test::sheet_setup();
    s.method = by_controls();
    options(s).control = FfdControl::energy;
    options(s).lattice.control_points = rest_places(options(s).lattice);
  });
  refused({"control_points", "3 control points", "7 x 6 x 4"}, [&](Setup& s) { options(s).lattice.control_points.resize(3); });
  for (const FfdControl control : {FfdControl::energy, FfdControl::mesh}) {
    refused({"handle \"end\"", "lattice", "CONTROLS"}, [&](Setup& s) { options(s).control = control; });
    refused({"handle \"end\"", "control", "CONTROLS"}, [&](Setup& s) {
      options(s).control = control;
      s.handles[0].region = ids({1});
    });
  }
  refused({"handle \"end\"", "lattice", "CONTROLS"}, [&](Setup& s) { s.method = RbfOptions{}; });
}

TEST(FfdByControls, ReportsABrokenLatticeOnce) {
  deform::Setup setup = control_setup(by_controls(LatticeBasis::uniform_cubic, {7, 3, 4}));
  Problems problems(Problems::Mode::collect);
  find_problems(test::bumpy_sheet(11, 6), setup, problems);
  ASSERT_EQ(problems.list().size(), 1u);
  EXPECT_EQ(problems.list()[0].field, "method.ffd.lattice.points[1]");
}

TEST(FfdByControls, AFoldedLatticeIsRefusedWithThePoint) {
  const auto mesh = shared(test::bumpy_sheet(11, 6));
  FfdOptions options = by_controls();
  options.lattice.control_points = rest_places(options.lattice);
  for (Vec3& c : options.lattice.control_points) c[0] = (c[0] - 1) * (c[0] - 1);
  test::expect_error(ErrorCode::invalid_argument, {"control_points", "point ", "folds over"},
                     [&] { prepare(mesh, control_setup(options)); });
}

TEST(FfdByControls, MotionsAreNotSplit) {
  const auto mesh = shared(test::flat_sheet(11, 6));
  const deform::Setup setup = control_setup(by_controls());
  SplitProblem problem{mesh, setup, mesh.get(), nullptr};
  test::expect_error(ErrorCode::invalid_argument, {"splitting", "CONTROLS"}, [&] { evaluate_split(problem, some_design); });
  test::expect_error(ErrorCode::invalid_argument, {"splitting", "CONTROLS"}, [&] { estimate_substep(*mesh, setup, mesh.get()); });
}

}  // namespace
}  // namespace deform::ffd_controls_test
