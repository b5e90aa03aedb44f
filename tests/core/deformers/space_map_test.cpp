// SPDX-License-Identifier: GPL-3.0-or-later
// Designs as maps of space: what points do that are not of the mesh. References are dense solutions, published formulas, whole
// models, and the deformation of meshes that have these points.
#include "core/deformers/space_map.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <functional>
#include <mutex>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/mirrored.h"
#include "tests/core/deformers/space_cases.h"
#include "tests/core/numerics/cages.h"
#include "tests/support/expect_error.h"
#include "tests/support/linear_algebra.h"

namespace deform::space_map_test {
namespace {

using test::distance;
using test::shared;

const Design bent{{0.1, 0.8, 0.2, -0.6}, {}};

Points mapped(const SpaceMap& map, const std::vector<Vec3>& points, SpaceMap::Found* told = nullptr) {
  Points out(points.size());
  const SpaceMap::Found found = map.evaluate(points, 0, out, {});
  if (told != nullptr) *told = found;
  return out;
}

Points direct(const System& system, const Design& design) { return system.evaluate({&design, 1}, EvaluationPath::direct)[0]; }

std::vector<Vec3> random_places(std::size_t count, const Vec3& low, const Vec3& high, std::uint64_t seed = 5) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Vec3> places(count);
  for (Vec3& x : places) {
    for (std::size_t k = 0; k < 3; ++k) x[k] = low[k] + (high[k] - low[k]) * uniform(random);
  }
  return places;
}

CageOptions cage_around_sheet(CageCoordinates coordinates) {
  const test::CageMesh mesh =
      test::prism({{1.1, 1.1, 0}, {0.9, 1.4, 0}, {-0.3, 1.3, 0}, {-0.2, -0.4, 0}, {2.4, -0.3, 0}, {2.3, 1.4, 0}}, 1);
  CageOptions options;
  options.vertices = mesh.vertices;
  for (Vec3& x : options.vertices) x = {x[0], x[1], 1.2 * x[2] - 0.6 + 0.05 * x[0]};
  options.triangles = mesh.triangles;
  options.coordinates = coordinates;
  return options;
}

deform::Setup with_method(const MethodOptions& method) {
  deform::Setup setup = test::setup_with_variables();
  setup.method = method;
  return setup;
}

/// Handles are vertices of the cage.
deform::Setup cage_setup(CageCoordinates coordinates) {
  deform::Setup setup = with_method(cage_around_sheet(coordinates));
  setup.handles[0].region = {Region::ControlIds{{4, 5, 10, 11}}};
  setup.handles[1].region = {Region::ControlIds{{0, 6}}};
  setup.fixed = {{Region::ControlIds{{2, 3}}}};
  return setup;
}

FfdOptions lattice_options(FfdControl control) {
  FfdOptions options;
  options.control = control;
  options.lattice.points = {6, 5, 5};
  options.lattice.frame = LatticeFrame{{-0.2, -0.2, -0.4}, {{{2.4, 0, 0}, {0, 1.4, 0}, {0, 0, 0.8}}}};
  return options;
}

deform::Setup control_setup() {
  deform::Setup setup = with_method(lattice_options(FfdControl::controls));
  setup.handles[0].region = {Region::ControlIds{{64, 65, 70, 71, 94, 95, 100, 101}}};
  setup.handles[1].region = {Region::ControlIds{{68, 69}}};
  setup.fixed = {};
  return setup;
}

std::vector<std::pair<std::string, deform::Setup>> all_setups() {
  std::vector<std::pair<std::string, deform::Setup>> setups;
  for (const Solver solver : {Solver::cholesky, Solver::ldlt, Solver::incremental_qr}) {
    RbfOptions rbf;
    rbf.solver = solver;
    setups.emplace_back(std::string("rbf ") + to_string(solver), with_method(rbf));
  }
  RbfOptions local;
  local.kernel = Kernel::wendland_c2;
  setups.emplace_back("rbf wendland", with_method(local));
  setups.emplace_back("mls", with_method(MlsOptions{}));
  MlsOptions soft;
  soft.handles = HandleMode::soft;
  setups.emplace_back("mls soft", with_method(soft));
  SubspaceOptions subspace;
  subspace.centres = 60;
  setups.emplace_back("subspace", with_method(subspace));
  subspace.kernel = Kernel::wendland_c2;
  setups.emplace_back("subspace wendland", with_method(subspace));
  subspace.linear = SubspaceLinear::left_out;
  setups.emplace_back("subspace wendland without linear", with_method(subspace));
  setups.emplace_back("ffd", with_method(lattice_options(FfdControl::energy)));
  setups.emplace_back("ffd MESH", with_method(lattice_options(FfdControl::mesh)));
  setups.emplace_back("ffd CONTROLS", control_setup());
  setups.emplace_back("cage", cage_setup(CageCoordinates::mean_value));
  setups.emplace_back("cage GREEN", cage_setup(CageCoordinates::green));
  deform::Setup cage = with_method(cage_around_sheet(CageCoordinates::mean_value));
  std::get<CageOptions>(cage.method).control = CageControl::mesh;
  setups.emplace_back("cage MESH", std::move(cage));
  return setups;
}

TEST(SpaceMap, AgreesAtThePointsOfTheMesh) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  const double diagonal = bounding_box(mesh->points).diagonal();
  for (const auto& [name, setup] : all_setups()) {
    SCOPED_TRACE(name);
    const auto system = prepare(mesh, setup);
    const auto map = system->bind_in_space(bent, {});
    SpaceMap::Found told;
    const Points got = mapped(*map, mesh->points, &told);
    EXPECT_EQ(got, direct(*system, bent));
    EXPECT_EQ(told.still, 0u);
    EXPECT_EQ(told.sums_error, 0);
    // The other path differs by the rounding of its sums; incremental QR chooses fewer centres for a design.
    if (name != "rbf incremental QR" && name.find("incremental") == std::string::npos) {
      EXPECT_LT(distance(got, system->evaluate(bent)), 1e-12 * diagonal);
    }
    EXPECT_GT(distance(got, mesh->points), 0.1);
  }
}

TEST(SpaceMap, DoesNotDependOnTheOtherPoints) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  const std::vector<Vec3> places = random_places(100, {0.1, 0.1, -0.2}, {1.9, 0.9, 0.2});
  for (const auto& [name, setup] : all_setups()) {
    SCOPED_TRACE(name);
    const auto system = prepare(mesh, setup);
    const auto map = system->bind_in_space(bent, {});
    const Points together = mapped(*map, places);
    for (const std::size_t i : {0u, 17u, 99u}) EXPECT_EQ(mapped(*map, {places[i]})[0], together[i]);
    // Smooth: close to a place it gives nearly the same.
    std::vector<Vec3> beside = places;
    for (Vec3& x : beside) x[0] += 1e-7;
    EXPECT_LT(distance(mapped(*map, beside), together), 1e-5);
  }
}

// Dense: phi(r) = r^3 and linear polynomials through all handle and fixed points.
TEST(SpaceMap, RbfIsTheInterpolantOfTheHandlePoints) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  deform::Setup setup = test::setup_with_variables();
  RbfOptions options;
  options.kernel = Kernel::triharmonic;
  options.reduction = CentreReduction::off;
  setup.method = options;
  const auto system = prepare(mesh, setup);
  const SelectedRegions regions = validate(setup, *mesh);
  const std::vector<Affine> motions = handle_motions(setup, bent.variables);
  std::vector<Vec3> centres, displacements;
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    for (const PointId id : regions.handles[h]) {
      centres.push_back(mesh->points[id]);
      displacements.push_back(transformed(motions[h], mesh->points[id]) - mesh->points[id]);
    }
  }
  for (const PointId id : regions.fixed) {
    centres.push_back(mesh->points[id]);
    displacements.push_back({});
  }
  const auto m = static_cast<Eigen::Index>(centres.size());
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(m + 4, m + 4), F = Eigen::MatrixXd::Zero(m + 4, 3);
  const auto cube = [](const Vec3& a, const Vec3& b) { return std::pow(norm(a - b), 3); };
  for (Eigen::Index i = 0; i < m; ++i) {
    const Vec3& x = centres[static_cast<std::size_t>(i)];
    for (Eigen::Index j = 0; j < m; ++j) A(i, j) = cube(x, centres[static_cast<std::size_t>(j)]);
    for (Eigen::Index k = 0; k < 4; ++k) A(i, m + k) = A(m + k, i) = k == 0 ? 1 : x[static_cast<std::size_t>(k - 1)];
    for (Eigen::Index k = 0; k < 3; ++k) F(i, k) = displacements[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)];
  }
  const Eigen::MatrixXd w = test::full_lu_solution(A, F);
  const std::vector<Vec3> places = random_places(200, {-0.5, -0.5, -0.5}, {2.5, 1.5, 0.5});
  const Points got = mapped(*system->bind_in_space(bent, {}), places);
  for (std::size_t i = 0; i < places.size(); ++i) {
    Vec3 expected = places[i];
    for (std::size_t k = 0; k < 3; ++k) {
      const auto c = static_cast<Eigen::Index>(k);
      for (Eigen::Index j = 0; j < m; ++j) expected[k] += w(j, c) * cube(places[i], centres[static_cast<std::size_t>(j)]);
      for (Eigen::Index p = 0; p < 4; ++p) expected[k] += w(m + p, c) * (p == 0 ? 1 : places[i][static_cast<std::size_t>(p - 1)]);
    }
    EXPECT_LT(distance(got[i], expected), 1e-9);
  }
}

/// Points that no region selects and that have no energy do not change the deformation: a mesh that has the places as further
/// points.
TEST(SpaceMap, IsTheDeformationOfAMeshThatHasThePoints) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  const std::vector<Vec3> places = random_places(150, {0.4, 0.1, -0.05}, {0.9, 0.9, 0.05});  // inside of the box of the mesh
  Mesh more = *mesh;
  more.points.insert(more.points.end(), places.begin(), places.end());
  const auto larger = shared(std::move(more));
  for (const auto& [name, setup] : all_setups()) {
    if (name.find("mls") != std::string::npos || name.find("subspace") != std::string::npos) continue;  // their samples change
    if (name.find("incremental") != std::string::npos) continue;
    SCOPED_TRACE(name);
    const auto system = prepare(mesh, setup);
    const Points expected = prepare(larger, setup)->evaluate(bent);
    const Points got = mapped(*system->bind_in_space(bent, {}), places);
    for (std::size_t i = 0; i < places.size(); ++i) EXPECT_LT(distance(got[i], expected[mesh->point_count() + i]), 1e-9);
  }
}

// One affine motion of all handles is that of space, where functions reproduce it and handles determine it.
TEST(SpaceMap, ReproducesAffineMotions) {
  const Affine map = test::turn_and_shift();
  const auto check = [&](const std::shared_ptr<const Mesh>& mesh, deform::Setup setup, const std::vector<Vec3>& places) {
    setup.fixed.clear();
    Design design;
    for (std::size_t h = 0; h < setup.handles.size(); ++h) design.motions.push_back({h, map});
    const Points got = mapped(*prepare(mesh, setup)->bind_in_space(design, {}), places);
    double worst = 0;
    for (std::size_t i = 0; i < places.size(); ++i) worst = std::max(worst, distance(got[i], transformed(map, places[i])));
    EXPECT_LT(worst, 1e-7);
  };
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  const std::vector<Vec3> places = random_places(200, {0.1, 0.1, -0.15}, {1.9, 0.9, 0.15});
  for (auto& [name, setup] : all_setups()) {
    SCOPED_TRACE(name);
    if (name == "rbf cholesky" || name == "rbf ldlt" || name == "rbf wendland" || name == "ffd") check(mesh, setup, places);
  }
  SCOPED_TRACE("mls");
  deform::Setup solid;
  solid.method = MlsOptions{};
  solid.handles = {{"top", test::box({-1, -1, 0.9}, {2, 2, 2})}, {"bottom", test::box({-1, -1, -1}, {2, 2, 0.1})}};
  check(shared(test::solid_cube(6)), solid, random_places(200, {0.05, 0.05, 0.05}, {0.95, 0.95, 0.95}));
}

TEST(SpaceMap, SymmetryPlanesHoldOnBothSides) {
  for (const std::size_t planes : {1u, 2u, 3u}) {
    const test::HalfModel model(planes, test::oblique());
    const test::WholeModel whole(model);
    std::vector<Vec3> local = random_places(60, {-0.9, -0.9, -0.9}, {0.9, 0.9, 0.9});
    for (std::size_t i = 0; i < 10; ++i) local[i][i % planes] = 0;
    FfdOptions ffd;
    ffd.lattice.frame = LatticeFrame{model.frame.point({-1.3, -1.3, -1.3}),
                                     {{2.6 * model.frame.axes[0], 2.6 * model.frame.axes[1], 2.6 * model.frame.axes[2]}}};
    ffd.lattice.points = {9, 9, 9};
    RbfOptions rbf;
    rbf.kernel = Kernel::triharmonic;
    rbf.reduction = CentreReduction::off;
    for (const MethodOptions& method : {MethodOptions(rbf), MethodOptions(ffd)}) {
      deform::Setup half = model.setup, all = whole.setup;
      half.method = all.method = method;
      const auto system = prepare(model.half, half);
      const auto map = system->bind_in_space(model.design(), {});
      EXPECT_EQ(mapped(*map, model.half->points), direct(*system, model.design()));
      std::vector<Vec3> places;
      for (const Vec3& y : local) places.push_back(model.frame.point(y));
      const Points got = mapped(*map, places);
      const Points expected = mapped(*prepare(whole.whole, all)->bind_in_space(whole.design, {}), places);
      EXPECT_LT(distance(got, expected), 1e-8);
      for (std::size_t i = 0; i < 10; ++i) {  // they stay in the plane
        EXPECT_LT(std::abs(dot(got[i] - model.frame.origin, model.frame.axes[i % planes])), 1e-13);
      }
    }
  }
}

TEST(SpaceMap, ConstraintsAreThoseOfTheDesign) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  for (const MethodOptions& method : {MethodOptions(MlsOptions{}), MethodOptions(lattice_options(FfdControl::energy))}) {
    for (const bool exact : {false, true}) {
      deform::Setup setup = with_method(method);
      Constraint patch{"patch", {test::box({1.2, 0.1, -9}, {1.6, 0.9, 9})}, Planar{}, exact ? 0 : 1e5};
      patch.exact = exact;
      setup.constraints = {patch};
      const auto system = prepare(mesh, setup);
      const auto map = system->bind_in_space(bent, {});
      EXPECT_EQ(mapped(*map, mesh->points), direct(*system, bent));
      setup.constraints.clear();
      EXPECT_GT(distance(mapped(*map, mesh->points), prepare(mesh, setup)->evaluate(bent)), 1e-4);
      // Beside a point of the patch it gives nearly the same, also where the exact step moved it.
      std::vector<Vec3> beside = mesh->points;
      for (Vec3& x : beside) x[2] += 1e-9;
      const double step = exact ? 0.02 : 1e-6;  // what the exact step carries is interpolated from a part of the points
      EXPECT_LT(distance(mapped(*map, beside), direct(*system, bent)), step);
    }
  }
}

TEST(SpaceMap, TheIterativeSolverKeepsItsTolerance) {
  const auto mesh = shared(test::bumpy_sheet(70, 36));
  const double diagonal = bounding_box(mesh->points).diagonal();
  deform::Setup setup = test::setup_with_variables();
  RbfOptions options;
  options.reduction = CentreReduction::off;
  options.solver = Solver::cholesky;
  options.basis = BasisMode::never;
  setup.method = options;
  const std::vector<Vec3> places = random_places(3000, {0, 0, -0.1}, {2, 1, 0.1});
  const Points exact = mapped(*prepare(mesh, setup)->bind_in_space(bent, {}), places);
  options.solver = Solver::iterative;
  options.tolerance = 1e-7;
  setup.method = options;
  const auto system = prepare(mesh, setup);
  const auto map = system->bind_in_space(bent, {});
  SpaceMap::Found told;
  EXPECT_LT(distance(mapped(*map, places, &told), exact), 20e-7 * diagonal);
  EXPECT_LT(told.sums_error, 1e-7 * diagonal);
  EXPECT_LT(distance(mapped(*map, mesh->points), direct(*system, bent)), 2e-7 * diagonal);
}

TEST(SpaceMap, OutsideOfALatticeNothingMoves) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  const std::vector<Vec3> places{{1.8, 0.5, 0}, {1.8, 0.5, 0.5}, {-1, 0, 0}, {1.8, 0.5, 1e6}};
  for (const auto& setup :
       {with_method(lattice_options(FfdControl::energy)), with_method(lattice_options(FfdControl::mesh)), control_setup()}) {
    const auto map = prepare(mesh, setup)->bind_in_space(bent, {});
    SpaceMap::Found told;
    const Points got = mapped(*map, places, &told);
    EXPECT_EQ(told.still, 3u);
    EXPECT_NE(got[0], places[0]);
    for (std::size_t i = 1; i < places.size(); ++i) EXPECT_EQ(got[i], places[i]);
  }
}

TEST(SpaceMap, MovedLattices) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  deform::Setup setup = control_setup();
  auto& lattice = std::get<FfdOptions>(setup.method).lattice;
  const Lattice at_rest = lattice_around(lattice, bounding_box(mesh->points));
  for (Vec3 c : at_rest.control_points()) lattice.control_points.push_back({c[0], c[1] + 0.05 * c[0] * c[0], c[2]});
  const auto system = prepare(mesh, setup);
  const auto map = system->bind_in_space(bent, {});
  EXPECT_EQ(mapped(*map, mesh->points), direct(*system, bent));
  EXPECT_GE(estimate(*mesh, setup).resident_bytes, system->bytes());
}

TEST(SpaceMap, RefusesWhatIsNotDefined) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  const auto refused = [&](const MethodOptions& method, const std::vector<const char*>& words) {
    const auto system = prepare(mesh, with_method(method));
    test::expect_error(ErrorCode::failed_precondition, words, [&] { system->bind_in_space(bent, {}); });
  };
  refused(ShellOptions{}, {"shell", "faces"});
  SubspaceOptions subspace;
  subspace.centres = 40;
  subspace.kernel = Kernel::triharmonic;
  refused(subspace, {"subspace", "kernel"});
  deform::Setup half = with_method(ShellOptions{});
  half.symmetry = {{SymmetryPlane::Plane{{0, 0, 0}, {0, 1, 0}}}};
  const auto mirrored = prepare(mesh, half);
  test::expect_error(ErrorCode::failed_precondition, {"shell"}, [&] { mirrored->bind_in_space(Design{}, {}); });

  const auto map = prepare(mesh, cage_setup(CageCoordinates::green))->bind_in_space(bent, {});
  const std::vector<Vec3> places{{1, 0.5, 0}, {1, 0.5, 0}, {1, 0.5, 7}};
  Points out(3);
  test::expect_error(ErrorCode::invalid_argument, {"points[42]", "outside of the cage"},
                     [&] { map->evaluate(places, 40, out, {}); });
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "variables"}, [&] {
    prepare(mesh, with_method(RbfOptions{}))->bind_in_space(Design{{1, 2}, {}}, {});
  });
}

// Two places for each point whose place is given: handle and fixed points where the solution does not determine them, and any
// point where constraints move them.
TEST(SpaceMap, SaysHowMuchMemoryItTakes) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  deform::Setup setup = with_method(MlsOptions{});
  const auto bytes = [&] { return prepare(mesh, setup)->space_bytes(1000).map; };
  const std::size_t held = estimate(*mesh, setup).constraint_points;
  ASSERT_GT(held, 20u);
  EXPECT_EQ(bytes(), 48 * held);
  setup.method = RbfOptions{};
  EXPECT_EQ(bytes(), 48 * held);
  MlsOptions soft;
  soft.handles = HandleMode::soft;
  setup.method = soft;
  EXPECT_EQ(bytes(), 0u);
  setup.method = MlsOptions{};
  setup.constraints = {{"patch", {test::box({1.2, 0.1, -9}, {1.6, 0.9, 9})}, Planar{}}};
  EXPECT_EQ(bytes(), 48 * mesh->point_count());
  // Calls with many places take the places in tiles and, with fast sums, their trees.
  setup.constraints.clear();
  const auto call = [&](Solver solver, std::size_t places) {
    setup.method = RbfOptions{.solver = solver, .reduction = CentreReduction::off};
    return prepare(mesh, setup)->space_bytes(places).call;
  };
  EXPECT_GE(call(Solver::cholesky, 1'000'000), call(Solver::cholesky, 1000) + 3 * 24 * 999'000u);
  EXPECT_GT(call(Solver::iterative, 1'000'000), call(Solver::cholesky, 1'000'000) + 1'000'000u);
  EXPECT_LT(call(Solver::iterative, 1'000'000), 100 * call(Solver::cholesky, 1'000'000));
}

TEST(SpaceMap, StopsWhenItIsToldTo) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  const std::vector<Vec3> places = random_places(100000, {0, 0, 0}, {1, 1, 0});
  Points out(places.size());
  const auto map = prepare(mesh, with_method(RbfOptions{}))->bind_in_space(bent, {});
  std::stop_source stop;
  stop.request_stop();
  RunContext context;
  context.stop = stop.get_token();
  test::expect_error(ErrorCode::cancelled, {}, [&] { map->evaluate(places, 0, out, context); });
}

// ---- many cotangents ----

TEST(VectorJacobians, AreThoseOfSingleCalls) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  auto setups = all_setups();
  setups.emplace_back("shell", with_method(ShellOptions{}));
  deform::Setup constrained = with_method(ShellOptions{});
  constrained.constraints = {{"patch", {test::box({1.2, 0.1, -9}, {1.6, 0.9, 9})}, Planar{}, 1e5}};
  setups.emplace_back("constraints", constrained);
  deform::Setup half = with_method(MlsOptions{});
  half.variables = {{"up", "end", DesignVariable::Translate{{0, 0, 1}}},
                    {"along", "end", DesignVariable::Translate{{1, 0, 0}}},
                    {"middle up", "middle", DesignVariable::Translate{{0, 0, 1}}},
                    {"middle along", "middle", DesignVariable::Translate{{1, 0, 0}}}};
  half.symmetry = {{SymmetryPlane::Plane{{0, 0, 0}, {0, 1, 0}}}};
  setups.emplace_back("mirrored", half);
  std::mt19937_64 random(9);
  std::normal_distribution<double> normal;
  std::vector<Points> cotangents(3, Points(mesh->point_count()));
  for (Points& field : cotangents) {
    for (Vec3& v : field) v = {normal(random), normal(random), normal(random)};
  }
  for (auto& [name, setup] : setups) {
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      if (name == "constraints" && basis == BasisMode::always) continue;
      SCOPED_TRACE(name);
      std::visit([&](auto& options) { options.basis = basis; }, setup.method);
      const auto system = prepare(mesh, setup);
      const auto together = system->vector_jacobians(bent.variables, cotangents, {});
      ASSERT_EQ(together.size(), cotangents.size());
      for (std::size_t j = 0; j < cotangents.size(); ++j) {
        const std::vector<double> alone = system->vector_jacobian(bent.variables, cotangents[j], {});
        ASSERT_EQ(together[j].size(), 4u);
        double size = 0;
        for (const double g : alone) size = std::max(size, std::abs(g));
        for (std::size_t k = 0; k < 4; ++k) EXPECT_NEAR(together[j][k], alone[k], 1e-10 * size);
        // The dot test, with the product in the other direction.
        const std::vector<double> direction{0.3, -0.7, 0.5, 0.9};
        const Points product = system->jacobian_vector(bent.variables, direction, {});
        double left = 0, right = 0, square = 0;
        for (std::size_t i = 0; i < product.size(); ++i) {
          left += dot(product[i], cotangents[j][i]);
          square += dot(product[i], product[i]);
        }
        for (std::size_t k = 0; k < 4; ++k) right += together[j][k] * direction[k];
        EXPECT_NEAR(left, right, 1e-8 * std::sqrt(square * static_cast<double>(3 * product.size())));
      }
    }
  }
}

// ---- stages ----

// Whoever waits is told what for: each stage whose time is stated has been reported when it began.
TEST(Stages, AreReportedByEveryMethod) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  auto setups = all_setups();
  setups.emplace_back("shell", with_method(ShellOptions{}));
  for (const auto& [name, setup] : setups) {
    SCOPED_TRACE(name);
    std::mutex mutex;
    std::set<std::string> told;
    RunContext context;
    context.on_progress = [&](const std::string& stage, double fraction) {
      const std::lock_guard lock(mutex);
      told.insert(stage);
      EXPECT_GE(fraction, 0);
      EXPECT_LE(fraction, 1);
    };
    const auto system = prepare(mesh, setup, context);
    EXPECT_FALSE(system->info().stage_seconds.empty());
    for (const auto& [stage, seconds] : system->info().stage_seconds) {
      if (stage != "basis") {  // there may be none
        EXPECT_EQ(told.count(stage), 1u) << stage;
      }
      EXPECT_GE(seconds, 0);
    }
  }
}

}  // namespace
}  // namespace deform::space_map_test
