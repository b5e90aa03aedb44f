// SPDX-License-Identifier: GPL-3.0-or-later
// RBF deformation: thesis 2.1, 3.5, 4.2 and 4.3. Figure 3.9 is tested in kernel_smoothness_test.cpp.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>

#include "core/deformers/rbf/rbf_system.h"
#include "core/mesh/adjacency.h"
#include "core/numerics/interpolation/dense_interpolator.h"
#include "tests/core/deformers/shapes.h"

namespace deform::rbf_rows_test {
namespace {

using test::bumpy_sheet;
using test::distance;
using test::shared;
using test::sheet_setup;
using test::turn_and_shift;

constexpr Kernel kernels[] = {Kernel::triharmonic,  Kernel::biharmonic,           Kernel::quintic,     Kernel::gaussian,
                              Kernel::multiquadric, Kernel::inverse_multiquadric, Kernel::wendland_c2, Kernel::thin_plate};

deform::Setup with(deform::Setup setup, RbfOptions options) {
  setup.method = options;
  return setup;
}

RbfOptions options_for(Kernel kernel) {
  RbfOptions options;
  options.kernel = kernel;
  return options;
}

Design moved(const Affine& motion) { return {{}, {{0, motion}}}; }

Points deformed(const std::shared_ptr<const Mesh>& mesh, const deform::Setup& setup, const Design& design) {
  return prepare(mesh, setup)->evaluate(design);
}

// Thesis 2.1.1: handles go where they are told, fixed points stay, the interpolant itself passes through both to 1e-9 D.
TEST(Regions, HandleFixedAndDeformableRegions) {
  const auto mesh = shared(bumpy_sheet(41, 21));
  const double D = bounding_box(mesh->points).diagonal();
  const SelectedRegions regions = validate(sheet_setup(), *mesh);
  for (const Kernel kernel : kernels) {
    const auto system = prepare(mesh, with(sheet_setup(), options_for(kernel)));
    const Design design = moved(turn_and_shift());
    const Points got = system->evaluate(design);
    for (const PointId id : regions.handles[0])
      EXPECT_LE(distance(got[id], transformed(turn_and_shift(), mesh->points[id])), 1e-9 * D);
    for (const PointId id : regions.fixed) EXPECT_EQ(got[id], mesh->points[id]);
    for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
      EXPECT_LE(system->bind({&design, 1}, path, {})->report(0).interpolation_residual, 1e-9 * D) << properties(kernel).name;
    }
    EXPECT_GT(distance(got, mesh->points), 0.1);
  }
}

// The same points as a sheet of quads, of triangles, of strips of polygons, and without faces.
std::vector<std::shared_ptr<const Mesh>> representations() {
  const Mesh quads = bumpy_sheet(33, 17);
  Mesh triangles = quads, polygons = quads, points = quads;
  triangles.face_sizes.clear();
  triangles.face_points.clear();
  for (std::size_t f = 0; f < quads.face_count(); ++f) {
    const PointId* q = quads.face_points.data() + 4 * f;
    for (const PointId id : {q[0], q[1], q[2], q[0], q[2], q[3]}) triangles.face_points.push_back(id);
    triangles.face_sizes.insert(triangles.face_sizes.end(), {3, 3});
  }
  polygons.face_sizes.clear();
  polygons.face_points.clear();
  for (PointId row = 0; row < 16; ++row) {  // hexagons: two quads side by side
    for (PointId i = 0; i < 32; i += 2) {
      const PointId a = 33 * row + i, b = a + 33;
      for (const PointId id : {a, a + 1, a + 2, b + 2, b + 1, b}) polygons.face_points.push_back(id);
      polygons.face_sizes.push_back(6);
    }
  }
  points.face_sizes.clear();
  points.face_points.clear();
  return {shared(quads), shared(triangles), shared(polygons), shared(points)};
}

// Thesis 2.1.3: one space deformation; the same coordinates get bitwise the same displacements, whatever connects them.
TEST(Representations, RepresentationsDoNotMatter) {
  RbfOptions all_centres;
  all_centres.reduction = CentreReduction::off;
  const auto meshes = representations();
  const Points expected = deformed(meshes[0], with(sheet_setup(), all_centres), moved(turn_and_shift()));
  for (const auto& mesh : meshes) {
    const Mesh before = *mesh;
    EXPECT_TRUE(deformed(mesh, with(sheet_setup(), all_centres), moved(turn_and_shift())) == expected);
    EXPECT_EQ(mesh->face_points, before.face_points);
    EXPECT_TRUE(mesh->points == before.points);
  }
}

// Thesis 3.5: every kernel interpolates, reproduces any affine map of everything, and is factored symmetrically.
TEST(Kernels, AffineMapsAreReproducedByEveryKernel) {
  const auto mesh = shared(bumpy_sheet(41, 21));
  const double D = bounding_box(mesh->points).diagonal();
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> uniform(-0.5, 0.5);
  for (const Kernel kernel : kernels) {
    deform::Setup setup = with(sheet_setup(), options_for(kernel));
    setup.handles.push_back({"start", setup.fixed[0]});
    setup.fixed.clear();
    const auto system = prepare(mesh, setup);
    EXPECT_TRUE(system->info().solver == Solver::cholesky || system->info().solver == Solver::ldlt);
    for (int i = 0; i < 3; ++i) {
      Affine motion = identity_affine;
      for (double& value : motion) value += uniform(random);
      const Design design{{}, {{0, motion}, {1, motion}}};
      const Points got = system->evaluate(design);
      for (std::size_t p = 0; p < got.size(); ++p) {
        EXPECT_LE(distance(got[p], transformed(motion, mesh->points[p])), 1e-9 * D) << properties(kernel).name;
      }
    }
  }
}

// Thesis 3.5: the side conditions sum w = 0, sum w x^T = 0 (eq. 3.9) hold to 1e-10 of the weights.
TEST(Kernels, WeightsCarryNoPolynomial) {
  const Mesh mesh = bumpy_sheet(21, 11);
  for (const Solver solver : {Solver::cholesky, Solver::ldlt}) {
    InterpolationOptions options;
    options.solver = solver;
    const DenseInterpolator system(mesh.points, options, {});
    Eigen::MatrixXd F(mesh.point_count(), 1);
    for (std::size_t i = 0; i < mesh.point_count(); ++i) F(static_cast<Eigen::Index>(i), 0) = std::sin(2 * mesh.points[i][0]);
    const Eigen::VectorXd w = system.interpolate(F, 0).coefficients.topRows(F.rows());
    Vec3 moments{};
    for (std::size_t i = 0; i < mesh.point_count(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) moments[k] += w[static_cast<Eigen::Index>(i)] * mesh.points[i][k];
    }
    const double size = w.cwiseAbs().sum();
    EXPECT_LE(std::abs(w.sum()), 1e-10 * size);
    for (const double moment : moments) EXPECT_LE(std::abs(moment), 1e-10 * size);
  }
}

// Largest change of the mean of neighbours minus the point (H n, umbrella form) from one row of the sheet to the next, at the
// border of the handle.
double border_jump(const Points& points, std::size_t columns, std::size_t rows, std::size_t border) {
  const auto umbrella = [&](std::size_t i, std::size_t j) {
    const auto at = [&](std::size_t a, std::size_t b) { return points[a + columns * b][2]; };
    return (at(i - 1, j) + at(i + 1, j) + at(i, j - 1) + at(i, j + 1)) / 4 - at(i, j);
  };
  double largest = 0;
  for (std::size_t j = 1; j + 1 < rows; ++j) {
    for (std::size_t i = border - 2; i <= border + 2; ++i) {
      largest = std::max(largest, std::abs(umbrella(i + 1, j) - umbrella(i, j)));
    }
  }
  return largest;
}

// Thesis 3.5, figure 3.10: exactly the constraint points within three rings of the deformable region are centres; the result
// hardly changes.
TEST(CentreReduction, ThreeRingsOfCentres) {
  constexpr std::size_t columns = 81, rows = 41;
  Mesh sheet = bumpy_sheet(columns, rows);
  const auto mesh = shared(sheet);
  deform::Setup setup = sheet_setup();
  setup.handles[0].region = test::box({1.4, -1, -1}, {3, 2, 1});
  setup.fixed[0] = test::box({-1, -1, -1}, {0.6, 2, 1});
  RbfOptions rings;
  rings.reduction = CentreReduction::rings;
  const auto reduced = prepare(mesh, with(setup, rings));
  RbfOptions off;
  off.reduction = CentreReduction::off;
  const auto full = prepare(mesh, with(setup, off));

  // Rings through quads: three columns of points on each side.
  EXPECT_TRUE(reduced->info().reduced);
  EXPECT_EQ(reduced->info().centres, 2u * 3 * rows);
  EXPECT_EQ(full->info().centres, full->info().constraint_points);
  EXPECT_LT(static_cast<double>(reduced->info().centres), 0.22 * static_cast<double>(full->info().centres));
  ASSERT_FALSE(reduced->info().notes.empty());

  Affine lift = identity_affine;
  lift[11] = 0.3;
  const Points few = reduced->evaluate(moved(lift)), many = full->evaluate(moved(lift));
  EXPECT_LT(distance(few, many), 0.01 * 0.3);
  RecordProperty("change_over_max_displacement", std::to_string(distance(few, many) / 0.3));
  EXPECT_LT(border_jump(few, columns, rows, 24), 1.05 * border_jump(many, columns, rows, 24));
  EXPECT_LT(border_jump(few, columns, rows, 56), 1.05 * border_jump(many, columns, rows, 56));
}

TEST(CentreReduction, RingsAreThoseOfTheMesh) {
  const Mesh sheet = bumpy_sheet(41, 21);
  for (const int rings : {1, 2, 3, 5}) {
    RbfOptions options;
    options.reduction = CentreReduction::rings;
    options.reduction_rings = rings;
    const auto system = prepare(shared(sheet), with(sheet_setup(), options));
    const SelectedRegions regions = validate(sheet_setup(), sheet);
    std::vector<char> deformable(sheet.point_count(), 1);
    for (const PointId id : regions.handles[0]) deformable[id] = 0;
    for (const PointId id : regions.fixed) deformable[id] = 0;
    const auto near = Adjacency(sheet).grow(deformable, rings);
    std::size_t expected = 0;
    for (std::size_t i = 0; i < near.size(); ++i) expected += near[i] && !deformable[i];
    EXPECT_EQ(system->info().centres, expected);
  }
}

TEST(CentreReduction, FullSetWhereTheMeshDoesNotAllowIt) {
  const auto full = [](Mesh mesh, const char* reason) {
    RbfOptions rings;
    rings.reduction = CentreReduction::rings;
    const auto system = prepare(shared(std::move(mesh)), with(sheet_setup(), rings));
    EXPECT_FALSE(system->info().reduced);
    EXPECT_EQ(system->info().centres + system->info().merged_duplicates, system->info().constraint_points);
    ASSERT_FALSE(system->info().notes.empty());
    EXPECT_NE(system->info().notes[0].find(reason), std::string::npos) << system->info().notes[0];
  };
  Mesh fan = bumpy_sheet(41, 21);  // a third face at an edge in the deformable region
  fan.points.push_back({1, 0.5, 1});
  fan.face_sizes.push_back(3);
  fan.face_points.insert(fan.face_points.end(), {430, 431, 861});
  full(fan, "not manifold");
  Mesh points = bumpy_sheet(41, 21);
  points.face_sizes.clear();
  points.face_points.clear();
  full(points, "no faces");
  Mesh island = bumpy_sheet(41, 21);  // a second component without any constraint
  for (const double x : {1.0, 1.1, 1.05}) island.points.push_back({x, x, 3});
  island.face_sizes.push_back(3);
  island.face_points.insert(island.face_points.end(), {861, 862, 863});
  full(island, "component");
  Mesh isolated = bumpy_sheet(41, 21);
  isolated.points.push_back({1, 0.5, 2});
  full(isolated, "no face holds 1 of the deformable points");
}

// Thesis 4.2: the handle basis equals the direct solve to 1e-10 D.
TEST(RbfBasis, BasisEqualsDirectSolve) {
  const auto mesh = shared(bumpy_sheet(61, 31));
  const auto system = prepare(mesh, sheet_setup());
  const Design design = moved(turn_and_shift());
  const Points basis = system->evaluate({&design, 1}, EvaluationPath::basis)[0];
  const Points direct = system->evaluate({&design, 1}, EvaluationPath::direct)[0];
  EXPECT_LE(distance(basis, direct), 1e-10 * system->info().diagonal);
}

deform::Setup with_variables() {
  deform::Setup setup = sheet_setup();
  setup.handles.push_back({"middle", test::box({0.95, 0.4, -1}, {1.05, 0.6, 1})});
  setup.variables.push_back({"up", "end", DesignVariable::Translate{{0.1, 0, 1}}});
  setup.variables.push_back({"turn", "end", DesignVariable::Rotate{{0, 1, 0.2}, {1.8, 0.5, 0}}});
  setup.variables.push_back({"grow", "middle", DesignVariable::Scale{{1, 0.5, 0}, {0, 1, 0}}});
  setup.variables.push_back({"roll", "middle", DesignVariable::Rotate{{1, 0, 0}, {1, 0.5, 0}}});
  return setup;
}

// Thesis 4.2: products with the Jacobian and its transpose agree (1e-12 of the sizes) and with central differences (1e-6), at
// rotations that are far from 0.
TEST(RbfBasis, JacobianProducts) {
  const auto mesh = shared(bumpy_sheet(41, 21));
  for (const BasisMode mode : {BasisMode::always, BasisMode::never}) {
    RbfOptions options;
    options.basis = mode;
    const auto system = prepare(mesh, with(with_variables(), options));
    const std::vector<double> at{0.1, 0.8, 0.2, -0.6}, direction{0.3, -0.7, 0.5, 0.9};
    const Points product = system->jacobian_vector(at, direction, {});
    constexpr double h = 1e-5;
    Design plus{at, {}}, minus{at, {}};
    for (std::size_t k = 0; k < at.size(); ++k) {
      plus.variables[k] += h * direction[k];
      minus.variables[k] -= h * direction[k];
    }
    const Points above = system->evaluate(plus), below = system->evaluate(minus);
    Points difference(above.size());
    for (std::size_t i = 0; i < above.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) difference[i][k] = (above[i][k] - below[i][k]) / (2 * h);
    }
    EXPECT_LT(distance(product, difference), 1e-6);

    std::mt19937_64 random(14);
    std::normal_distribution<double> normal;
    Points cotangent(mesh->point_count());
    double left = 0, left_size = 0, cotangent_size = 0;
    for (std::size_t i = 0; i < cotangent.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        cotangent[i][k] = normal(random);
        left += cotangent[i][k] * product[i][k];
        left_size += product[i][k] * product[i][k];
        cotangent_size += cotangent[i][k] * cotangent[i][k];
      }
    }
    const std::vector<double> gradient = system->vector_jacobian(at, cotangent, {});
    double right = 0;
    for (std::size_t k = 0; k < at.size(); ++k) right += gradient[k] * direction[k];
    EXPECT_NEAR(left, right, 1e-12 * std::sqrt(left_size * cotangent_size));
  }
}

// Thesis 4.2: a population is the same as its designs one by one, bit for bit, on both paths.
TEST(RbfBasis, PopulationsEqualSingles) {
  const auto system = prepare(shared(bumpy_sheet(41, 21)), with_variables());
  std::mt19937_64 random(15);
  std::uniform_real_distribution<double> uniform(-0.3, 0.3);
  std::vector<Design> designs(15);
  for (Design& design : designs) design.variables = {uniform(random), uniform(random), uniform(random), uniform(random)};
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const auto together = system->evaluate(designs, path);
    for (std::size_t i = 0; i < designs.size(); ++i) {
      EXPECT_TRUE(system->evaluate({&designs[i], 1}, path)[0] == together[i]) << i;
    }
  }
}

// Thesis 4.3: caps, needles, collapsed and repeated faces, a third face at an edge and faces through each other change nothing
// when all constraint points are centres.
TEST(DegenerateFaces, DegenerateFacesDoNotMatter) {
  const Mesh clean = bumpy_sheet(41, 21);
  Mesh defective = clean;
  const auto add = [&](std::initializer_list<PointId> face) {
    defective.face_sizes.push_back(static_cast<std::uint32_t>(face.size()));
    defective.face_points.insert(defective.face_points.end(), face);
  };
  add({430, 431, 432});           // a cap: three points of a row
  add({400, 401, 860});           // a needle
  add({500, 500, 501});           // an edge as a face
  add({510, 510, 510});           // a point as a face
  add({300, 301, 342, 341});      // a face twice
  add({300, 301, 600});           // a third face at an edge
  add({100, 700, 400, 350, 20});  // through everything
  RbfOptions all_centres;
  all_centres.reduction = CentreReduction::off;
  for (const Kernel kernel : {Kernel::triharmonic, Kernel::biharmonic}) {
    all_centres.kernel = kernel;
    const deform::Setup setup = with(sheet_setup(), all_centres);
    const Points expected = deformed(shared(clean), setup, moved(turn_and_shift()));
    EXPECT_TRUE(deformed(shared(defective), setup, moved(turn_and_shift())) == expected);
  }
  // With rings as centres the mesh is noticed, and the full set taken.
  RbfOptions rings, off;
  rings.reduction = CentreReduction::rings;
  off.reduction = CentreReduction::off;
  EXPECT_TRUE(deformed(shared(defective), with(sheet_setup(), rings), moved(turn_and_shift())) ==
              deformed(shared(clean), with(sheet_setup(), off), moved(turn_and_shift())));
}

}  // namespace
}  // namespace deform::rbf_rows_test
