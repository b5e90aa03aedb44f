// SPDX-License-Identifier: GPL-3.0-or-later
// The method cage with Green coordinates (thesis 3.4). The reference is quadrature of their definition.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <array>
#include <cmath>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/compiled_form.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/numerics/cages.h"
#include "tests/core/numerics/green_reference.h"
#include "tests/support/expect_error.h"

namespace deform::green_test {
namespace {

using test::shared;

Region vertex_ids(std::vector<std::uint32_t> list) { return {Region::ControlIds{std::move(list)}}; }

/// Around the sheet [0, 2] x [0, 1], not convex: twelve vertices, a notch beside the sheet.
CageOptions green_options(BasisMode basis = BasisMode::automatic) {
  const test::CageMesh mesh =
      test::prism({{1.1, 1.1, 0}, {0.9, 1.4, 0}, {-0.3, 1.3, 0}, {-0.2, -0.4, 0}, {2.4, -0.3, 0}, {2.3, 1.4, 0}}, 1);
  CageOptions options;
  options.vertices = mesh.vertices;
  for (Vec3& x : options.vertices) x = {x[0], x[1], 1.2 * x[2] - 0.6 + 0.05 * x[0]};
  options.triangles = mesh.triangles;
  options.coordinates = CageCoordinates::green;
  options.basis = basis;
  return options;
}

deform::Setup green_setup(const CageOptions& options = green_options()) {
  deform::Setup setup = test::setup_with_variables();
  setup.method = options;
  setup.handles[0].region = vertex_ids({4, 5, 10, 11});
  setup.handles[1].region = vertex_ids({0, 6});
  setup.fixed = {vertex_ids({2, 3})};
  return setup;
}

const Design turned_design{{0.1, 0.8, 0.2, -0.6}, {}};

/// All vertices follow one handle.
deform::Setup one_handle(const CageOptions& options) {
  deform::Setup setup;
  setup.method = options;
  setup.handles = {{"all", {Region::Complement{{{Region::Intersection{{vertex_ids({1}), vertex_ids({2})}}}}}}}};
  return setup;
}

std::vector<Vec3> moved_vertices(const deform::Setup& setup, const CageOptions& options, const Design& design) {
  const std::vector<Affine> motions = handle_motions(setup, design.variables);
  std::vector<Vec3> result = options.vertices;
  for (std::size_t h = 0; h < 2; ++h) {
    for (const std::uint32_t i : std::get<Region::ControlIds>(setup.handles[h].region.kind).ids) {
      result[i] = transformed(motions[h], options.vertices[i]);
    }
  }
  return result;
}

/// Formula (8) of the paper: sum of phi v' and psi s n'.
Vec3 by_definition(const CageOptions& options, const std::vector<Vec3>& moved, const Vec3& x) {
  const Cage cage(options.vertices, options.triangles);
  const auto at = test::GreenQuadrature(cage).at(x);
  Vec3 result{};
  for (std::size_t i = 0; i < moved.size(); ++i) result = result + at.phi[i] * moved[i];
  for (std::size_t t = 0; t < cage.triangles().size(); ++t) {
    const auto& [a, b, c] = cage.triangles()[t];
    const Vec3 u = options.vertices[b] - options.vertices[a], v = options.vertices[c] - options.vertices[a];
    const Vec3 mu = moved[b] - moved[a], mv = moved[c] - moved[a];
    const double area = norm(cross(u, v)) / 2;
    const double stretch =
        std::sqrt(dot(mu, mu) * dot(v, v) - 2 * dot(mu, mv) * dot(u, v) + dot(mv, mv) * dot(u, u)) / (std::sqrt(8.0) * area);
    result = result + (at.psi[t] * stretch / norm(cross(mu, mv))) * cross(mu, mv);
  }
  return result;
}

TEST(GreenCage, IsTheSumOverVerticesAndNormals) {
  const auto mesh = shared(test::bumpy_sheet(9, 5));
  for (const BasisMode basis : {BasisMode::automatic, BasisMode::never}) {
    const CageOptions options = green_options(basis);
    const deform::Setup setup = green_setup(options);
    const auto system = prepare(mesh, setup);
    EXPECT_EQ(system->info().functions, 12u);
    EXPECT_EQ(system->info().handle_points, 6u);
    EXPECT_EQ(system->info().fixed_points, 2u);
    EXPECT_EQ(system->info().basis_fields, 0u);
    const std::vector<Vec3> moved = moved_vertices(setup, options, turned_design);
    const Points got = system->evaluate(turned_design);
    double farthest = 0, largest = 0;
    for (std::size_t i = 0; i < got.size(); ++i) {
      EXPECT_LT(distance(got[i], by_definition(options, moved, mesh->points[i])), 1e-10) << i;
      farthest = std::max(farthest, distance(got[i], mesh->points[i]));
    }
    for (std::size_t i = 0; i < moved.size(); ++i) largest = std::max(largest, distance(moved[i], options.vertices[i]));
    EXPECT_GT(farthest, 0.3);
    const DesignReport report = system->bind({&turned_design, 1}, EvaluationPath::automatic, {})->report(0);
    EXPECT_EQ(report.path, EvaluationPath::direct);
    EXPECT_NEAR(report.control_displacement, largest, 1e-12);
    EXPECT_LT(report.error, 1e-12);
    EXPECT_EQ(system->evaluate(Design{{0, 0, 0, 0}, {}}), mesh->points) << "exactly at rest";
  }
}

TEST(GreenCage, TakesADisplacementPerVertex) {
  const auto mesh = shared(test::bumpy_sheet(9, 5));
  const CageOptions options = green_options();
  const std::vector<Vec3> displacements{{0.1, -0.2, 0.3}, {0, 0.1, 0.2}};
  std::vector<Vec3> moved = options.vertices;
  moved[0] = moved[0] + displacements[0];
  moved[6] = moved[6] + displacements[1];
  const Points got = prepare(mesh, green_setup(options))->evaluate({{}, {{1, displacements}}});
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(got[i], by_definition(options, moved, mesh->points[i])), 1e-10);
}

TEST(GreenCage, FollowsSimilaritiesOfTheWholeCage) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  const auto system = prepare(mesh, one_handle(green_options()));
  const double c = 2.5 * std::cos(0.8), s = 2.5 * std::sin(0.8);
  for (const Affine& motion :
       {Affine{c, -s, 0, 0.3, s, c, 0, -0.2, 0, 0, 2.5, 0.7}, Affine{0.3, 0, 0, 0, 0, 0.3, 0, 0, 0, 0, 0.3, 5}}) {
    const Points got = system->evaluate({{}, {{0, motion}}});
    for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(got[i], transformed(motion, mesh->points[i])), 1e-13);
  }
}

/// The largest ratio of principal stretches over points inside the cage, by differences.
double largest_distortion(CageOptions options, CageCoordinates coordinates, const std::vector<Vec3>& displacements) {
  options.coordinates = coordinates;
  constexpr double h = 1e-5;
  Mesh points;
  for (double x = 0.2; x < 3.9; x += 0.4) {
    for (const double y : {0.2, 0.5, 0.8}) {
      for (const double z : {0.3, 0.6}) {
        for (std::size_t k = 0; k < 3; ++k) {
          for (const double sign : {-1.0, 1.0}) {
            points.points.push_back({x, y, z});
            points.points.back()[k] += sign * h;
          }
        }
      }
    }
  }
  const auto mesh = shared(std::move(points));
  const Points got = prepare(mesh, one_handle(options))->evaluate({{}, {{0, displacements}}});
  double largest = 0;
  for (std::size_t i = 0; i < got.size(); i += 6) {
    Eigen::Matrix3d J;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 column = (got[i + 2 * k + 1] - got[i + 2 * k]) / (2 * h);
      for (std::size_t j = 0; j < 3; ++j) J(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) = column[j];
    }
    const Eigen::Vector3d stretches = J.jacobiSvd().singularValues();
    largest = std::max(largest, stretches[0] / stretches[2]);
  }
  return largest;
}

// What Green coordinates are for: shapes are distorted less than by mean value coordinates where a cage is sheared.
TEST(GreenCage, DistortsLessThanMeanValues) {
  CageOptions options;
  std::vector<Vec3> displacements;
  const std::uint32_t rings = 5;
  for (std::uint32_t r = 0; r < rings; ++r) {
    for (const auto& [y, z] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}}) {
      options.vertices.push_back({double(r), double(y), double(z)});
      displacements.push_back({0, 0, 0.8 * r});  // sheared
    }
  }
  for (std::uint32_t r = 0; r + 1 < rings; ++r) {
    for (std::uint32_t k = 0; k < 4; ++k) {
      const std::uint32_t a = 4 * r + k, b = 4 * r + (k + 1) % 4;
      options.triangles.push_back({a, a + 4, b + 4});
      options.triangles.push_back({a, b + 4, b});
    }
  }
  const std::uint32_t last = 4 * (rings - 1);
  for (const auto& triangle : {Cage::Triangle{0, 1, 2}, {0, 2, 3}, {last, last + 2, last + 1}, {last, last + 3, last + 2}}) {
    options.triangles.push_back(triangle);
  }
  const double green = largest_distortion(options, CageCoordinates::green, displacements);
  const double mean_value = largest_distortion(options, CageCoordinates::mean_value, displacements);
  EXPECT_GT(mean_value, 2.1) << "sheared by 0.8";
  EXPECT_LT(green, 1.6);
}

TEST(GreenCage, StoredCoordinatesGiveTheSameBits) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  const auto stored = prepare(mesh, green_setup(green_options(BasisMode::always)));
  const auto computed = prepare(mesh, green_setup(green_options(BasisMode::never)));
  EXPECT_GT(stored->info().bytes, computed->info().bytes + mesh->point_count() * 20 * sizeof(double));
  EXPECT_EQ(stored->evaluate(turned_design), computed->evaluate(turned_design));
  std::vector<Design> designs(4, turned_design);
  for (std::size_t i = 0; i < designs.size(); ++i) designs[i].variables[i] += 0.3;
  const std::vector<Points> together = stored->evaluate(designs);
  for (std::size_t i = 0; i < designs.size(); ++i) EXPECT_EQ(computed->evaluate(designs[i]), together[i]);
  const std::vector<double> direction{1, 2, 3, 4};
  EXPECT_EQ(stored->jacobian_vector(turned_design.variables, direction, {}),
            computed->jacobian_vector(turned_design.variables, direction, {}));
  const Points cotangent = stored->evaluate(turned_design);
  EXPECT_EQ(stored->vector_jacobian(turned_design.variables, cotangent, {}),
            computed->vector_jacobian(turned_design.variables, cotangent, {}));
}

TEST(GreenCage, JacobianProducts) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    test::check_jacobians(*prepare(mesh, green_setup(green_options(basis))), 1e-14, 1e-8);
  }
}

TEST(GreenCage, EstimatesBoundWhatIsTaken) {
  for (const std::size_t columns : {31u, 91u}) {
    const auto mesh = shared(test::bumpy_sheet(columns, columns / 2 + 1));
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      const deform::Setup setup = green_setup(green_options(basis));
      test::expect_bounds(estimate(*mesh, setup), prepare(mesh, setup)->info());
    }
  }
}

TEST(GreenCage, RefusesPointsOutside) {
  Mesh mesh = test::bumpy_sheet(9, 5);
  mesh.points[7] = {0.92, 1.3, 0.05};   // inside, beside the notch
  mesh.points[12] = {1.12, 1.25, 0.1};  // in the notch
  mesh.points[30] = {1.3, 1.3, 0.1};
  test::expect_error(ErrorCode::invalid_argument,
                     {"method.cage.coordinates", "GREEN", "points 12 and 30 of 45 lie outside", "MEAN_VALUE"},
                     [&] { prepare(shared(mesh), green_setup()); });
  test::expect_error(ErrorCode::invalid_argument,
                     {"method.cage.coordinates", "GREEN", "points 12 and 30 of 45 lie outside", "MEAN_VALUE"},
                     [&] { estimate(mesh, green_setup()); });
  Mesh many = mesh;  // most of 30,000 points in between, of which every second is looked at
  many.points.resize(30000, mesh.points[7]);
  test::expect_error(ErrorCode::invalid_argument, {"points 12 and 30 of 15000 that were looked at lie outside"},
                     [&] { estimate(many, green_setup()); });
  mesh.points[3] = {1, 0.5, 7};
  test::expect_error(ErrorCode::invalid_argument, {"method.cage.coordinates", "1 points", "outside of its box", "first is 3"},
                     [&] { validate(green_setup(), mesh); });

  CageOptions twice = green_options();
  const auto first = static_cast<std::uint32_t>(twice.vertices.size());
  const test::CageMesh other = test::box_cage({0.9, -0.1, -0.4}, {3, 1, 0.4});
  twice.vertices.insert(twice.vertices.end(), other.vertices.begin(), other.vertices.end());
  for (const auto& [a, b, c] : other.triangles) twice.triangles.push_back({a + first, b + first, c + first});
  test::expect_error(ErrorCode::invalid_argument, {"method.cage.coordinates", "GREEN", "where parts of the cage overlap"},
                     [&] { prepare(shared(test::bumpy_sheet(9, 5)), green_setup(twice)); });
}

TEST(GreenCage, TakesPointsOnTheCage) {
  const CageOptions options = green_options();
  Mesh on;
  for (const auto& [a, b, c] : options.triangles) {
    for (const Vec3& lambda : {Vec3{1, 0, 0}, Vec3{0.25, 0.75, 0}, Vec3{0.2, 0.5, 0.3}}) {
      on.points.push_back(lambda[0] * options.vertices[a] + lambda[1] * options.vertices[b] + lambda[2] * options.vertices[c]);
    }
  }
  const auto mesh = shared(std::move(on));
  const Affine motion{0, -2, 0, 1, 2, 0, 0, 3, 0, 0, 2, 0};
  const Points got = prepare(mesh, one_handle(options))->evaluate({{}, {{0, motion}}});
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(got[i], transformed(motion, mesh->points[i])), 1e-13);
}

TEST(GreenCage, RefusesWhatItCannotDo) {
  const auto mesh = shared(test::bumpy_sheet(9, 5));
  const auto refused = [&](const std::vector<const char*>& parts, const auto& spoil) {
    CageOptions options = green_options();
    spoil(options);
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { validate(green_setup(options), *mesh); });
  };
  refused({"method.cage.coordinates", "GREEN", "CONTROLS", "MEAN_VALUE"}, [](CageOptions& o) { o.control = CageControl::mesh; });
  refused({"method.cage.basis_tolerance", "GREEN"}, [](CageOptions& o) { o.basis_tolerance = 1e-6; });

  const auto system = prepare(mesh, green_setup());
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "BASIS", "without a basis"}, [&] {
    system->evaluate({&turned_design, 1}, EvaluationPath::basis);
  });
  test::expect_error(ErrorCode::failed_precondition, {"cannot be compiled", "Green coordinates", "MEAN_VALUE"},
                     [&] { CompiledForm form(system); });
}

TEST(GreenCage, RefusesDesignsWithoutNormals) {
  const auto mesh = shared(test::bumpy_sheet(9, 5));
  const CageOptions options = green_options();
  const auto system = prepare(mesh, one_handle(options));
  std::vector<Vec3> displacements(options.vertices.size());
  const Cage::Triangle triangle = options.triangles[5];
  displacements[triangle[2]] =
      lerp(options.vertices[triangle[0]], options.vertices[triangle[1]], 0.4) - options.vertices[triangle[2]];
  const std::vector<Design> designs{{}, {{}, {{0, displacements}}}};
  test::expect_error(ErrorCode::invalid_argument, {"designs[1]", "onto a line", "triangle 5"},
                     [&] { system->evaluate(designs); });
}

}  // namespace
}  // namespace deform::green_test
