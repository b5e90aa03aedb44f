// SPDX-License-Identifier: GPL-3.0-or-later
// The method cage: handles move the vertices of a cage (thesis 3.4). The reference are the published formulas of mean value
// coordinates, in long double.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <utility>

#include "core/base/vectors.h"
#include "core/deformers/splitting.h"
#include "core/deformers/system.h"
#include "core/mesh/ahmed.h"
#include "core/mesh/cages/cage_around.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/numerics/cages.h"
#include "tests/support/expect_error.h"
#include "tests/support/linear_algebra.h"

namespace deform::cage_test {
namespace {

using test::shared;
using Real = long double;

Region ids(std::vector<std::uint32_t> list) { return {Region::ControlIds{std::move(list)}}; }

/// Around the sheet [0, 2] x [0, 1]: twelve vertices, not convex. Part of the sheet sticks out through the notch.
CageOptions cage_options(Vec3 shift = {}) {
  const test::CageMesh mesh =
      test::prism({{1.1, 0.6, 0}, {1.1, 1.3, 0}, {-0.2, 1.3, 0}, {-0.2, -0.3, 0}, {2.4, -0.3, 0}, {2.4, 0.6, 0}}, 1);
  CageOptions options;
  options.vertices = mesh.vertices;
  for (Vec3& x : options.vertices) x = x + Vec3{0, 0, -0.5 + 0.05 * x[0]} + shift;
  options.triangles = mesh.triangles;
  return options;
}

/// Handles and variables of test::setup_with_variables() on vertices.
deform::Setup cage_setup(const CageOptions& options = cage_options()) {
  deform::Setup setup = test::setup_with_variables();
  setup.method = options;
  setup.handles[0].region = ids({5, 4, 10, 11});
  setup.handles[1].region = ids({0, 7});
  setup.fixed = {ids({2, 3})};
  return setup;
}

const Design some_design{{0.1, 0.8, 0.2, -0.6}, {}};

/// Mean value coordinates as Ju, Schaefer and Warren print them (2005, figure 4), without the cases on the cage.
std::vector<double> published(const CageOptions& cage, const Vec3& at) {
  using Vector = std::array<Real, 3>;
  const auto inner = [](const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
  const std::size_t n = cage.vertices.size();
  std::vector<Vector> u(n);
  std::vector<Real> d(n), w(n, 0);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < 3; ++k) u[i][k] = Real(cage.vertices[i][k]) - Real(at[k]);
    d[i] = std::sqrt(inner(u[i], u[i]));
    for (Real& x : u[i]) x /= d[i];
  }
  for (const auto& t : cage.triangles) {
    std::array<Real, 3> theta{}, c{}, s{};
    Real half = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      theta[k] = std::acos(inner(u[t[(k + 1) % 3]], u[t[(k + 2) % 3]]));
      half += theta[k] / 2;
    }
    const auto& [a, b, e] = std::tuple{u[t[0]], u[t[1]], u[t[2]]};
    const Real det = a[0] * (b[1] * e[2] - b[2] * e[1]) + a[1] * (b[2] * e[0] - b[0] * e[2]) + a[2] * (b[0] * e[1] - b[1] * e[0]);
    for (std::size_t k = 0; k < 3; ++k) {
      c[k] = 2 * std::sin(half) * std::sin(half - theta[k]) / (std::sin(theta[(k + 1) % 3]) * std::sin(theta[(k + 2) % 3])) - 1;
      s[k] = (det > 0 ? 1 : -1) * std::sqrt(1 - c[k] * c[k]);
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t l = (k + 1) % 3, m = (k + 2) % 3;
      w[t[k]] += (theta[k] - c[l] * theta[m] - c[m] * theta[l]) / (d[t[k]] * std::sin(theta[l]) * s[m]);
    }
  }
  Real sum = 0;
  for (const Real x : w) sum += x;
  std::vector<double> result;
  for (const Real x : w) result.push_back(static_cast<double>(x / sum));
  return result;
}

Vec3 moved_by(const CageOptions& cage, const std::vector<Vec3>& displacements, const Vec3& x) {
  const std::vector<double> values = published(cage, x);
  Vec3 result = x;
  for (std::size_t i = 0; i < values.size(); ++i) result = result + values[i] * displacements[i];
  return result;
}

std::vector<Vec3> displacements(const deform::Setup& setup, const CageOptions& cage, const Design& design) {
  const std::vector<Affine> motions = handle_motions(setup, design.variables);
  std::vector<Vec3> result(cage.vertices.size());
  for (std::size_t h = 0; h < 2; ++h) {
    for (const std::uint32_t i : std::get<Region::ControlIds>(setup.handles[h].region.kind).ids) {
      result[i] = transformed(motions[h], cage.vertices[i]) - cage.vertices[i];
    }
  }
  return result;
}

TEST(Cage, IsTheSumOverItsVertices) {
  const auto mesh = shared(test::bumpy_sheet(23, 12));
  const CageOptions options = cage_options();
  const deform::Setup setup = cage_setup(options);
  const auto system = prepare(mesh, setup);
  EXPECT_EQ(system->info().functions, 12u);
  EXPECT_EQ(system->info().handle_points, 6u);
  EXPECT_EQ(system->info().fixed_points, 2u);
  EXPECT_EQ(system->info().basis_fields, 8u);
  const std::vector<Vec3> moved = displacements(setup, options, some_design);
  double largest = 0;
  for (const Vec3& u : moved) largest = std::max(largest, norm(u));
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const Points got = system->evaluate({&some_design, 1}, path)[0];
    double farthest = 0;
    for (std::size_t i = 0; i < got.size(); ++i) {
      EXPECT_LT(distance(got[i], moved_by(options, moved, mesh->points[i])), 1e-12) << i;
      farthest = std::max(farthest, distance(got[i], mesh->points[i]));
    }
    EXPECT_GT(farthest, 0.3);
    const DesignReport report = system->bind({&some_design, 1}, path, {})->report(0);
    EXPECT_NEAR(report.control_displacement, largest, 1e-12);
    EXPECT_LT(report.error, 1e-10);
    EXPECT_TRUE(report.warnings.empty());
  }
}

TEST(Cage, TakesADisplacementPerVertex) {
  const auto mesh = shared(test::bumpy_sheet(23, 12));
  const CageOptions options = cage_options();
  std::vector<Vec3> moved(12);
  moved[0] = {0.1, -0.2, 0.3};
  moved[7] = {0, 0.1, 0.2};
  const Points got = prepare(mesh, cage_setup(options))->evaluate({{}, {{1, std::vector<Vec3>{moved[0], moved[7]}}}});
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(got[i], moved_by(options, moved, mesh->points[i])), 1e-12);
}

TEST(Cage, AllVerticesTogetherMoveAffinely) {
  const auto mesh = shared(test::bumpy_sheet(23, 12));
  const Affine motion{1.1, -0.2, 0.3, 0.1, 0.25, 0.9, 0.1, -0.05, -0.1, 0.2, 1.3, 0.2};
  deform::Setup setup;
  setup.method = cage_options();
  setup.handles = {{"all", {Region::Complement{{{Region::Intersection{{ids({1}), ids({2})}}}}}}}};
  const Design design{{}, {{0, motion}}};
  const auto system = prepare(mesh, setup);
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const Points got = system->evaluate({&design, 1}, path)[0];
    for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(got[i], transformed(motion, mesh->points[i])), 1e-13);
  }
}

// On the cage points go where its triangles go: faces, edges and vertices.
TEST(Cage, PointsOnTheCageFollowIt) {
  const CageOptions options = cage_options();
  Mesh on;
  std::vector<Vec3> expected;
  const deform::Setup setup = cage_setup(options);
  const std::vector<Vec3> moved = displacements(setup, options, some_design);
  for (const auto& [a, b, c] : options.triangles) {
    for (const Vec3& lambda : {Vec3{1, 0, 0}, Vec3{0.25, 0.75, 0}, Vec3{0.2, 0.5, 0.3}}) {
      const auto mean = [&](const std::vector<Vec3>& of) { return lambda[0] * of[a] + lambda[1] * of[b] + lambda[2] * of[c]; };
      on.points.push_back(mean(options.vertices));
      expected.push_back(on.points.back() + mean(moved));
    }
  }
  const auto mesh = shared(std::move(on));
  EXPECT_LT(test::distance(prepare(mesh, setup)->evaluate(some_design), expected), 1e-12);
}

TEST(Cage, JacobianProductsAndPopulations) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    CageOptions options = cage_options();
    options.basis = basis;
    const auto system = prepare(mesh, cage_setup(options));
    EXPECT_EQ(system->info().basis_fields, basis == BasisMode::always ? 8u : 0u);
    test::check_jacobians(*system, 1e-14, 1e-8);
  }
  test::check_population(*prepare(mesh, cage_setup()), 5);
}

TEST(Cage, BasisToATolerance) {
  const auto mesh = shared(test::bumpy_sheet(91, 46));
  CageOptions options = cage_options();
  options.basis = BasisMode::always;
  const auto exact = prepare(mesh, cage_setup(options));
  options.basis_tolerance = 1e-6;
  const auto rounded = prepare(mesh, cage_setup(options));
  EXPECT_LT(rounded->info().basis_bytes, exact->info().basis_bytes);
  const double away = test::distance(exact->evaluate(some_design), rounded->evaluate(some_design));
  EXPECT_LE(away, rounded->bind({&some_design, 1}, EvaluationPath::basis, {})->report(0).error);
  EXPECT_GT(away, 0);
}

TEST(Cage, CountsPointsOutside) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  std::size_t outside = 0;
  for (const Vec3& x : mesh->points) outside += x[0] > 1.1 && x[1] > 0.6 ? 1 : 0;
  EXPECT_GT(outside, 50u);
  EXPECT_THAT(prepare(mesh, cage_setup())->info().notes,
              testing::Contains(testing::HasSubstr(std::to_string(outside) + " points lie outside of the cage")));
  deform::Setup setup = cage_setup();
  CageOptions around = cage_options();
  const test::CageMesh box = test::box_cage({-0.5, -0.5, -1}, {2.5, 1.5, 1});
  around.vertices = box.vertices;
  around.triangles = box.triangles;
  setup.method = around;
  setup.handles[0].region = ids({0});
  setup.handles[1].region = ids({1});
  const auto inside = prepare(mesh, setup);
  EXPECT_THAT(inside->info().notes, testing::Not(testing::Contains(testing::HasSubstr("outside"))));
  EXPECT_THAT(inside->info().notes, testing::Not(testing::Contains(testing::HasSubstr("units"))));
  EXPECT_EQ(inside->info().solver, Solver::automatic) << "there is none";
}

TEST(Cage, SaysWhenItLooksLikeAnotherUnitOrAnotherPlace) {
  const auto mesh = shared(test::bumpy_sheet(21, 11));
  const auto notes_with = [&](double scale, const Vec3& shift) {
    deform::Setup setup = cage_setup();
    CageOptions cage = cage_options();
    for (Vec3& x : cage.vertices) x = scale * x + shift;
    setup.method = cage;
    const std::vector<std::string> notes = prepare(mesh, setup)->info().notes, expected = estimate(*mesh, setup).notes;
    for (const std::string& note : notes) {
      if (note.find("units") != std::string::npos) {
        EXPECT_THAT(expected, testing::Contains(note)) << "before it is prepared";
      }
    }
    return notes;
  };
  EXPECT_THAT(notes_with(1000, {}), testing::Contains(testing::HasSubstr("times that of the mesh: are both in the same units?")));
  EXPECT_THAT(notes_with(1e-3, {}), testing::Contains(testing::HasSubstr("in the same units?")));
  EXPECT_THAT(notes_with(1, {50, 0, 0}),
              testing::Contains(testing::HasSubstr("No point of the mesh lies in the cage: is it the cage")));
  EXPECT_THAT(notes_with(1, {}), testing::Not(testing::Contains(testing::HasSubstr("units"))));
}

/// With the planes in which a cage is its own mirror image in its first note.
std::string note_of(const CageOptions& options) {
  deform::Setup setup = cage_setup(options);
  for (auto& handle : setup.handles) handle.region = ids({0});
  setup.handles[1].region = ids({1});
  setup.fixed.clear();
  return estimate(test::bumpy_sheet(9, 5), setup).notes.at(0);
}

TEST(Cage, SaysInWhichPlanesItIsItsOwnMirrorImage) {
  CageOptions octahedron;
  octahedron.vertices = {{5, 0, 0}, {-5, 0, 0}, {0, 4, 0}, {0, -4, 0}, {0, 0, 3}, {0, 0, -3}};
  octahedron.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  EXPECT_THAT(note_of(octahedron), testing::EndsWith("14.14, its own mirror image in x = 0, y = 0 and z = 0."));
  CageOptions moved = octahedron;
  for (Vec3& x : moved.vertices) x = x + Vec3{1, 0, 0};
  EXPECT_THAT(note_of(moved), testing::EndsWith(" image in x = 1, y = 0 and z = 0."));
  CageOptions tip = octahedron;
  tip.vertices[4][2] = 3.5;
  EXPECT_THAT(note_of(tip), testing::EndsWith(" image in x = 0 and y = 0."));
  tip.vertices[4][0] = 1e-6;
  EXPECT_THAT(note_of(tip), testing::EndsWith(" image in y = 0."));
  CageOptions turned = octahedron;
  for (Vec3& x : turned.vertices) x = {0.6 * x[0] - 0.8 * x[1], 0.8 * x[0] + 0.6 * x[1], x[2]};
  EXPECT_THAT(note_of(turned), testing::HasSubstr(" image in z = 0, the plane through ("));
  // Its moments are all the same, so that its principal axes are any.
  CageOptions regular = octahedron;
  for (Vec3& x : regular.vertices) {
    const double size = norm(x), c = std::cos(0.4), s = std::sin(0.4);
    const Vec3 y{(c * x[0] - s * x[1]) / size, (s * x[0] + c * x[1]) / size, x[2] / size};
    x = {y[0], 0.6 * y[1] - 0.8 * y[2], 0.8 * y[1] + 0.6 * y[2]};
  }
  const std::string note = note_of(regular);
  std::size_t told = 0;
  for (std::size_t at = note.find("the plane through"); at != std::string::npos; at = note.find("the plane through", at + 1))
    ++told;
  EXPECT_GE(told, 3u) << note;
  EXPECT_THAT(note_of(cage_options()), testing::Not(testing::HasSubstr("image")));
  // The vertices are images of each other, but not the triangles.
  CageOptions box;
  box.vertices = {{-1, -1, -1}, {3, -1, -1}, {-1, 2, -1}, {3, 2, -1}, {-1, -1, 1}, {3, -1, 1}, {-1, 2, 1}, {3, 2, 1}};
  box.triangles = {{0, 3, 1}, {0, 2, 3}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                   {2, 7, 3}, {2, 6, 7}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  EXPECT_THAT(note_of(box), testing::Not(testing::HasSubstr("image")));
}

TEST(Cage, EstimatesBoundWhatIsTaken) {
  for (const std::size_t columns : {31u, 91u}) {
    const auto mesh = shared(test::bumpy_sheet(columns, columns / 2 + 1));
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      CageOptions options = cage_options();
      options.basis = basis;
      test::expect_bounds(estimate(*mesh, cage_setup(options)), prepare(mesh, cage_setup(options))->info());
    }
  }
}

// ---- direct manipulation ----

deform::Setup mesh_setup(double clamp = 0) {
  deform::Setup setup = test::setup_with_variables();
  CageOptions options = cage_options();
  options.control = CageControl::mesh;
  options.clamp = clamp;
  setup.method = options;
  return setup;
}

/// Least squares of least norm, by Eigen's decomposition of the matrix of the published coordinates.
TEST(CageByMesh, IsThePseudoInverse) {
  const auto mesh = shared(test::bumpy_sheet(23, 12));
  const CageOptions cage = cage_options();
  for (const double clamp : {1e-2, 1e-4}) {
    const deform::Setup setup = mesh_setup(clamp);
    const SelectedRegions regions = validate(setup, *mesh);
    const std::vector<Affine> motions = handle_motions(setup, some_design.variables);
    std::vector<std::pair<PointId, Vec3>> held;
    for (std::size_t h = 0; h < 2; ++h) {
      for (const PointId id : regions.handles[h]) {
        held.emplace_back(id, transformed(motions[h], mesh->points[id]) - mesh->points[id]);
      }
    }
    for (const PointId id : regions.fixed) held.emplace_back(id, Vec3{});
    Eigen::MatrixXd A(held.size(), 12), b(held.size(), 3);
    for (std::size_t i = 0; i < held.size(); ++i) {
      const auto row = static_cast<Eigen::Index>(i);
      const std::vector<double> values = published(cage, mesh->points[held[i].first]);
      for (std::size_t k = 0; k < 12; ++k) A(row, static_cast<Eigen::Index>(k)) = values[k];
      for (std::size_t k = 0; k < 3; ++k) b(row, static_cast<Eigen::Index>(k)) = held[i].second[k];
    }
    const test::ThinSvd<double> svd = test::thin_svd(A);
    const Eigen::Index rank = (svd.values.array() > clamp * svd.values[0]).count();
    const Eigen::MatrixXd w =
        svd.V.leftCols(rank) * svd.values.head(rank).cwiseInverse().asDiagonal() * svd.U.leftCols(rank).transpose() * b;
    std::vector<Vec3> moved;
    for (Eigen::Index k = 0; k < 12; ++k) moved.push_back({w(k, 0), w(k, 1), w(k, 2)});
    const double missed = (A * w - b).rowwise().norm().maxCoeff(), farthest = w.rowwise().norm().maxCoeff();
    const auto system = prepare(mesh, setup);
    EXPECT_EQ(system->info().handle_points, regions.handles[0].size() + regions.handles[1].size());
    for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
      const Points got = system->evaluate({&some_design, 1}, path)[0];
      for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(got[i], moved_by(cage, moved, mesh->points[i])), 1e-9);
      const DesignReport report = system->bind({&some_design, 1}, path, {})->report(0);
      EXPECT_NEAR(report.control_displacement, farthest, 1e-9 * farthest);
      EXPECT_NEAR(report.interpolation_residual, missed, 1e-9);
      EXPECT_LT(report.error, 1e-8);
    }
  }
}

TEST(CageByMesh, AffineMotionsOfAllHandlesAreMet) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  deform::Setup setup = mesh_setup(1e-8);
  setup.handles = {{"all", {Region::All{}}}};
  setup.fixed.clear();
  setup.variables.clear();
  const Affine motion{1.1, -0.2, 0.3, 0.1, 0.25, 0.9, 0.1, -0.05, -0.1, 0.2, 1.3, 0.2};
  const Points got = prepare(mesh, setup)->evaluate({{}, {{0, motion}}});
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(got[i], transformed(motion, mesh->points[i])), 1e-9);
}

/// The largest difference between the displacement of a point and the image of that of its image, for the roof of a car lifted by
/// 0.03.
double asymmetry_of(const Mesh& car, const CageAround& cage) {
  CageOptions options;
  options.vertices = cage.mesh.points;
  for (std::size_t c = 0; c < cage.mesh.face_points.size(); c += 3) {
    options.triangles.push_back({cage.mesh.face_points[c], cage.mesh.face_points[c + 1], cage.mesh.face_points[c + 2]});
  }
  options.control = CageControl::mesh;
  deform::Setup setup;
  setup.method = options;
  setup.handles = {{"roof", {Region::InBox{{0.3, -1, 0.3}, {0.6, 1, 1}}}}};
  setup.fixed = {{Region::InBox{{-1, -1, -1}, {2, 1, 0.1}}}};
  const Points moved = prepare(shared(car), setup)->evaluate(Design{{}, {{0, Affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.03}}}});
  std::map<Vec3, std::size_t> at;
  for (std::size_t i = 0; i < car.point_count(); ++i) at[car.points[i]] = i;
  double worst = 0;
  for (std::size_t i = 0; i < car.point_count(); ++i) {
    const Vec3& x = car.points[i];
    const Vec3 image = moved[at.at({x[0], x[1] == 0 ? 0 : -x[1], x[2]})];
    worst = std::max(worst, distance(moved[i], {image[0], -image[1], image[2]}));
  }
  return worst;
}

/// An octahedron whose faces are split into n^2 triangles, on a sphere.
Mesh octahedral_sphere(double radius, std::uint32_t n) {
  Mesh mesh;
  std::map<std::array<int, 3>, PointId> seen;
  const auto point = [&](const std::array<int, 3>& at) {
    const auto [it, added] = seen.emplace(at, static_cast<PointId>(mesh.points.size()));
    const Vec3 x{static_cast<double>(at[0]), static_cast<double>(at[1]), static_cast<double>(at[2])};
    if (added) mesh.points.push_back((radius / norm(x)) * x);
    return it->second;
  };
  const auto side = static_cast<int>(n);
  for (int octant = 0; octant < 8; ++octant) {
    const std::array<int, 3> sign{octant & 1 ? -1 : 1, octant & 2 ? -1 : 1, octant & 4 ? -1 : 1};
    const bool inward = sign[0] * sign[1] * sign[2] < 0;
    const auto corner = [&](int i, int j) { return point({sign[0] * i, sign[1] * j, sign[2] * (side - i - j)}); };
    const auto add = [&](PointId a, PointId b, PointId c) {
      if (inward) std::swap(b, c);
      mesh.face_sizes.push_back(3);
      mesh.face_points.insert(mesh.face_points.end(), {a, b, c});
    };
    for (int i = 0; i < side; ++i) {
      for (int j = 0; i + j < side; ++j) {
        add(corner(i, j), corner(i + 1, j), corner(i, j + 1));
        if (i + j + 1 < side) add(corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
      }
    }
  }
  return mesh;
}

/// A fine cage has much that the affine motions of handles say little about. Where a clamp that keeps it back misses them by no
/// more than 1e-5, it does: a weaker one crumples the surface beside the handles.
TEST(CageByMesh, AutomaticClampsKeepFineCagesBack) {
  const Mesh cage = octahedral_sphere(1.15, 13);
  const auto mesh = shared(octahedral_sphere(1, 24));
  const Region::InBox above{{-2, -2, 0.7}, {2, 2, 2}}, below{{-2, -2, -2}, {2, 2, -0.7}};
  deform::Setup setup;
  setup.handles = {{"cap", Region{above}}};
  setup.fixed = {Region{below}};
  const auto report = [&](double clamp) {
    CageOptions options;
    options.vertices = cage.points;
    for (std::size_t f = 0; f < cage.face_sizes.size(); ++f) {
      options.triangles.push_back({cage.face_points[3 * f], cage.face_points[3 * f + 1], cage.face_points[3 * f + 2]});
    }
    options.control = CageControl::mesh;
    options.clamp = clamp;
    setup.method = options;
    const auto system = prepare(mesh, setup);
    const auto moved = [&](const std::function<Vec3(const Vec3&)>& by) {
      std::vector<Vec3> displacements;
      for (const Vec3& x : mesh->points) {
        if (x[2] >= 0.7) displacements.push_back(by(x));
      }
      const Design design{{}, {{0, displacements}}};
      return system->bind({&design, 1}, EvaluationPath::direct, {})->report(0);
    };
    const DesignReport shifted = moved([](const Vec3& x) { return Vec3{0.1, 0.2 * x[0], 0.3}; });
    const DesignReport wave = moved([](const Vec3& x) { return Vec3{0, 0, 0.2 * std::sin(3 * x[0])}; });
    return std::pair(shifted.misfit / shifted.prescribed_displacement, wave.control_displacement / wave.prescribed_displacement);
  };
  const auto [missed, motion] = report(0);
  const auto [missed_by_weak, motion_of_weak] = report(1e-7);
  std::printf("automatic: %.2g of the motion missed, waves move control points by %.3g; 1e-7: %.2g, %.3g\n", missed, motion,
              missed_by_weak, motion_of_weak);
  EXPECT_LT(missed, 3e-5);
  EXPECT_LT(missed_by_weak, missed);
  EXPECT_LT(motion, 6);
  EXPECT_GT(motion_of_weak, 10 * motion);
}

TEST(CageByMesh, SymmetricMotionsOfASymmetricModelAreSymmetric) {
  const Mesh car = ahmed_body({.target_points = 2000});
  EXPECT_LT(asymmetry_of(car, cage_around(car, {.points = 150})), 0.03 * 1e-11);
  EXPECT_GT(asymmetry_of(car, cage_around(car, {.points = 150, .symmetry_tolerance = 0})), 0.03 * 0.05)
      << "else this shows nothing";
}

TEST(CageByMesh, JacobianProductsAndPopulations) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    deform::Setup setup = mesh_setup();
    std::get<CageOptions>(setup.method).basis = basis;
    const auto system = prepare(mesh, setup);
    EXPECT_EQ(system->info().basis_fields, basis == BasisMode::always ? 8u : 0u);
    test::check_jacobians(*system, 1e-13, 1e-7);
  }
  test::check_population(*prepare(mesh, mesh_setup()), 5);
}

TEST(CageByMesh, EstimatesBoundWhatIsTaken) {
  const auto mesh = shared(test::bumpy_sheet(91, 46));
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    deform::Setup setup = mesh_setup();
    std::get<CageOptions>(setup.method).basis = basis;
    const Estimate expected = estimate(*mesh, setup);
    const SystemInfo info = prepare(mesh, setup)->info();
    EXPECT_GE(expected.resident_bytes, info.bytes);
    EXPECT_LE(static_cast<double>(expected.resident_bytes), 2.5 * static_cast<double>(info.bytes));
    EXPECT_GE(expected.peak_bytes, expected.resident_bytes);
    EXPECT_EQ(expected.samples, info.samples);
    EXPECT_EQ(expected.constraint_points, info.constraint_points);
  }
}

TEST(Cage, RefusesWhatIsWrong) {
  const Mesh mesh = test::bumpy_sheet(11, 6);
  const auto refused = [&](const std::vector<const char*>& parts, const auto& spoil) {
    deform::Setup setup = cage_setup();
    spoil(setup);
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { validate(setup, mesh); });
  };
  using Setup = deform::Setup;
  const auto options = [](Setup& s) -> CageOptions& { return std::get<CageOptions>(s.method); };
  refused({"handle \"end\"", "points of the mesh", "CONTROLS"}, [](Setup& s) {
    s.handles[0].region = test::box({0, 0, 0}, {1, 1, 1});
  });
  refused({"handle \"end\"", "lattice", "there is none"}, [](Setup& s) { s.handles[0].region = {Region::LatticeRange{}}; });
  refused({"handle \"middle\"", "control.ids", "12", "control point"}, [](Setup& s) { s.handles[1].region = ids({3, 12}); });
  refused({"fixed[0]", "overlaps handle \"end\"", "1 common control points"}, [](Setup& s) { s.fixed = {ids({4})}; });
  refused({"constraints", "method.cage"}, [](Setup& s) { s.constraints.push_back({"flat", {{Region::All{}}}, Planar{}}); });
  refused({"method.cage.triangles", "the cage is open at the edge between vertices"},
          [&](Setup& s) { options(s).triangles.pop_back(); });
  refused({"method.cage.vertices[3]", "finite"},
          [&](Setup& s) { options(s).vertices[3][0] = std::numeric_limits<double>::infinity(); });
  refused({"method.cage.vertices", "4 to 10000"}, [&](Setup& s) { options(s).vertices.clear(); });
  refused({"method.cage.clamp: 0.7"}, [&](Setup& s) { s = mesh_setup(0.7); });
  refused({"handle \"end\"", "control", "CONTROLS"}, [&](Setup& s) { options(s).control = CageControl::mesh; });
  refused({"method.cage.basis_tolerance"}, [&](Setup& s) { options(s).basis_tolerance = 0.1; });
}

TEST(Cage, ReportsABrokenCageOnce) {
  deform::Setup setup = cage_setup();
  std::get<CageOptions>(setup.method).triangles.pop_back();
  Problems problems(Problems::Mode::collect);
  find_problems(test::bumpy_sheet(11, 6), setup, problems);
  ASSERT_EQ(problems.list().size(), 1u);
  EXPECT_EQ(problems.list()[0].field, "method.cage");
}

TEST(Cage, MotionsAreNotSplit) {
  const auto mesh = shared(test::flat_sheet(11, 6));
  const deform::Setup setup = cage_setup();
  SplitProblem problem{mesh, setup, mesh.get(), nullptr};
  test::expect_error(ErrorCode::invalid_argument, {"splitting", "CONTROLS"}, [&] { evaluate_split(problem, some_design); });
}

}  // namespace
}  // namespace deform::cage_test
