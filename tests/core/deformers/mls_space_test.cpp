// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/mls.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "core/deformers/energy/spaces/mesh_pieces.h"
#include "core/mesh/ahmed.h"
#include "tests/core/deformers/space_cases.h"
#include "tests/support/expect_error.h"
#include "tests/support/thesis_options.h"

namespace deform::mls_space_test {
namespace {

using test::at_samples;
using test::energy;

MlsOptions options(double stretching, double bending, std::size_t surface = 300, std::size_t volume = 0) {
  MlsOptions chosen = test::thesis_mls();
  chosen.stretching = stretching;
  chosen.bending = bending;
  chosen.surface_samples = surface;
  chosen.volume_samples = volume;
  return chosen;
}

bool same(const SparseRows& a, const SparseRows& b) {
  return a.nonZeros() == b.nonZeros() && std::equal(a.valuePtr(), a.valuePtr() + a.nonZeros(), b.valuePtr()) &&
         std::equal(a.innerIndexPtr(), a.innerIndexPtr() + a.nonZeros(), b.innerIndexPtr());
}

void expect_positions(const Mesh& mesh, const EnergySpace& space, double tolerance) {
  const Box box = bounding_box(mesh.points);
  const Eigen::MatrixXd found = space.values * Eigen::MatrixXd(space.linear);
  double worst = 0, worst_sum = 0;
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    worst_sum = std::max(worst_sum, std::abs(found(row, 0) - 1));
    for (std::size_t k = 0; k < 3; ++k) {
      worst = std::max(
          worst, std::abs(found(row, static_cast<Eigen::Index>(k) + 1) - (mesh.points[i][k] - box.min[k]) / box.diagonal()));
    }
  }
  EXPECT_LT(worst_sum, 1e-11);
  EXPECT_LT(worst, tolerance);
}

TEST(MlsSpace, ReproducesLinearMotionsOfSurfacesAndVolumes) {
  const Mesh plane = test::thesis_plane(), cube = test::solid_cube(5), body = ahmed_body({.target_points = 2000});
  expect_positions(plane, mls_space(plane, options(1, 1), 1), 1e-10);
  expect_positions(cube, mls_space(cube, options(1, 1, 200, 100), 1), 1e-10);
  // Flat faces beside rounded edges: samples a little off the plane, which count as in it, up to 1e-3 of a radius.
  expect_positions(body, mls_space(body, options(1, 1, 500), 1), 2e-5);
}

/// Functions that are nonzero at one of these points.
std::size_t reaching(const EnergySpace& space, const std::vector<PointId>& ids) {
  std::vector<bool> reached(static_cast<std::size_t>(space.values.cols()));
  for (const PointId id : ids) {
    space.functions().for_each(id, [&](std::int64_t column, double) { reached[static_cast<std::size_t>(column)] = true; });
  }
  return static_cast<std::size_t>(std::count(reached.begin(), reached.end(), true));
}

TEST(MlsSpace, FunctionsThatReachAPatchAreEstimatedByItsArea) {
  const Mesh body = ahmed_body({.target_points = 8000});
  const MlsOptions chosen = options(1, 1, 2000);
  const EnergySpace space = mls_space(body, chosen, 1);
  const auto estimated = [&](const Mesh& mesh, const MlsOptions& of, const std::vector<PointId>& ids) {
    std::vector<Vec3> places;
    for (const PointId id : ids) places.push_back(mesh.points[id]);
    return estimate_mls_reach(mesh, of, places);
  };
  for (const double width : {0.03, 0.1, 0.25}) {
    SCOPED_TRACE(width);
    std::vector<PointId> patch;
    for (PointId id = 0; id < body.points.size(); ++id) {
      const Vec3& x = body.points[id];
      if (std::abs(x[0] - 0.6) < width && x[1] > 0.1) patch.push_back(id);
    }
    const std::size_t reached = reaching(space, patch), bound = estimated(body, chosen, patch);
    ASSERT_GT(reached, 0u);
    EXPECT_GE(bound, reached);
    EXPECT_LE(bound, 2 * reached);
    EXPECT_LT(bound, 2000u);
  }
  std::vector<PointId> all(body.points.size());
  for (PointId id = 0; id < all.size(); ++id) all[id] = id;
  EXPECT_EQ(estimated(body, chosen, all), 2000u);
}

TEST(MlsSpace, FunctionsThatReachAPatchOfCellsAreEstimatedByTheSamplesAroundIt) {
  const MlsOptions chosen = options(1, 1, 700, 700);
  for (const double thickness : {1.0, 0.1}) {
    SCOPED_TRACE(thickness);
    Mesh block = test::solid_cube(10);
    for (Vec3& x : block.points) x[2] *= thickness;
    const EnergySpace space = mls_space(block, chosen, 1);
    for (const double width : {0.05, 0.3}) {
      SCOPED_TRACE(width);
      std::vector<PointId> patch;
      std::vector<Vec3> places;
      for (PointId id = 0; id < block.points.size(); ++id) {
        const Vec3& x = block.points[id];
        if (x[0] > 0.01 || std::abs(x[1] - 0.5) > width) continue;
        patch.push_back(id);
        places.push_back(x);
      }
      const std::size_t reached = reaching(space, patch), bound = estimate_mls_reach(block, chosen, places);
      ASSERT_GT(reached, 0u);
      EXPECT_GE(bound, reached);
      EXPECT_LE(bound, 2 * reached + 100);
    }
    EXPECT_EQ(estimate_mls_reach(block, chosen, block.points), 1400u);
  }
}

TEST(MlsSpace, LinearMotionsDoNotBendAndStretchByTheirSize) {
  const Mesh cube = test::solid_cube(5);
  const auto along = [](double x, double y, double z) { return 2 * x - y + 3 * z + 4; };
  const EnergySpace stretched = mls_space(cube, options(1, 0, 200, 100), 1), bent = mls_space(cube, options(0, 1, 200, 100), 1);
  const double volume = std::pow(3.0, -1.5);  // of a cube whose diagonal is 1
  EXPECT_NEAR(energy(stretched, at_samples(stretched, along)), 14 * volume, 1e-9);
  EXPECT_NEAR(energy(bent, at_samples(bent, along)), 0, 1e-9);
  const Mesh plane = test::thesis_plane();
  const EnergySpace flat = mls_space(plane, options(1, 0), 1);
  const Box box = bounding_box(plane.points);
  const double area = box.max[0] * box.max[1] / (box.diagonal() * box.diagonal());
  EXPECT_NEAR(energy(flat, at_samples(flat, along)), 5 * area, 1e-9);
  EXPECT_GE(energy(flat, at_samples(flat, [](double x, double y, double /*z*/) { return x * y; })), 0);
}

// The second derivatives of linear moving least squares of a quadratic function are not those of the function: from a
// cover of 12 they are close.
TEST(MlsSpace, BendingOfQuadraticFunctions) {
  const Mesh cube = test::solid_cube(5);
  MlsOptions chosen = options(0, 1, 400, 400);
  const double volume = std::pow(3.0, -1.5);
  const auto saddle = [](double x, double y, double /*z*/) { return x * x - y * y; };
  const EnergySpace full = mls_space(cube, chosen, 1);
  EXPECT_NEAR(energy(full, at_samples(full, saddle)) / (8 * volume), 1, 0.35);
}

TEST(MlsSpace, SameForEveryUnitAndNumberOfThreads) {
  Mesh mesh = test::solid_cube(4);
  RunContext one, two;
  one.threads = 1;
  two.threads = 2;
  const EnergySpace a = mls_space(mesh, options(1, 1, 150, 80), 7, one), b = mls_space(mesh, options(1, 1, 150, 80), 7, two);
  EXPECT_TRUE(same(a.values, b.values));
  EXPECT_TRUE(same(SparseRows(a.energy), SparseRows(b.energy)));
  for (Vec3& x : mesh.points) x = {1024 * x[0], 1024 * x[1], 1024 * x[2]};  // exact
  const EnergySpace large = mls_space(mesh, options(1, 1, 150, 80), 7);
  EXPECT_TRUE(same(a.values, large.values));
  EXPECT_TRUE(same(SparseRows(a.energy), SparseRows(large.energy)));
  EXPECT_FALSE(same(a.values, mls_space(mesh, options(1, 1, 150, 80), 8).values));
}

TEST(MlsSpace, PointCloudsAndSoups) {
  Mesh soup = test::flat_grid(20, 20, 1, 1);
  const Mesh whole = soup;
  // A face without area, one that repeats a corner, faces of one and two corners, a face twice, a point in no face.
  soup.face_points.insert(soup.face_points.end(), {0, 1, 2, 5, 5, 9, 3, 4, 7, 0, 1, 21});
  soup.face_sizes.insert(soup.face_sizes.end(), {3, 3, 1, 2, 3});
  soup.points.push_back({0.5, 0.5, 0.001});
  soup.points.push_back(soup.points.front());
  Mesh cloud = whole;
  cloud.face_points.clear();
  cloud.face_sizes.clear();
  for (const Mesh& mesh : {soup, cloud}) {
    mesh.validate();
    const EnergySpace space = mls_space(mesh, options(1, 0), 3);
    EXPECT_EQ(space.samples, 300u);
    std::vector<PointId> held;
    for (PointId i = 0; i < 400; ++i) {
      if (mesh.points[i][0] < 0.1 || mesh.points[i][0] > 0.9) held.push_back(i);
    }
    Eigen::VectorXd prescribed(static_cast<Eigen::Index>(held.size()));
    for (std::size_t i = 0; i < held.size(); ++i)
      prescribed[static_cast<Eigen::Index>(i)] = mesh.points[held[i]][0] < 0.5 ? 0 : 1;
    const Eigen::VectorXd moved = test::least_energy(space, held, prescribed);
    EXPECT_TRUE(moved.allFinite());
    for (PointId i = 0; i < 400; ++i) EXPECT_NEAR(moved[i], std::clamp((mesh.points[i][0] - 0.07) / 0.86, 0.0, 1.0), 0.05);
  }
}

// What the notes say of supports, by the samples that have a value at each point.
TEST(MlsSpace, NotesHaveTheRadiusAndHowOftenItCovers) {
  const Mesh mesh = test::solid_cube(5);
  const double diagonal = bounding_box(mesh.points).diagonal();
  const EnergySpace space = mls_space(mesh, options(1, 1, 200, 100), 1);
  const Eigen::MatrixXd samples = Eigen::MatrixXd(space.linear).rightCols(3);
  double farthest = 0;
  for (Eigen::Index i = 0; i < space.values.rows(); ++i) {
    const Vec3& x = mesh.points[static_cast<std::size_t>(i)];
    for (SparseRows::InnerIterator entry(space.values, i); entry; ++entry) {
      farthest = std::max(farthest, (samples.row(entry.col()) - Eigen::RowVector3d(x[0], x[1], x[2]) / diagonal).norm());
    }
  }
  int on_surface = 0, inside = 0;
  double radius = 0, cover = 0;
  ASSERT_EQ(std::sscanf(space.notes.at(0).c_str(),
                        "%d samples on the surface, %d in the volume; supports of radius %lf D, which cover a point %lf times",
                        &on_surface, &inside, &radius, &cover),
            4)
      << space.notes[0];
  EXPECT_EQ(on_surface, 200);
  EXPECT_EQ(inside, 100);
  EXPECT_NEAR(cover, static_cast<double>(space.values.nonZeros()) / static_cast<double>(mesh.point_count()), 0.051);
  EXPECT_LT(farthest, 1.005 * radius);  // of three digits
  EXPECT_GT(farthest, 0.95 * radius);
}

// Parts that nothing holds follow those nearby instead of making the system singular.
TEST(MlsSpace, PartsFarApartFollowEachOther) {
  Mesh mesh = test::flat_grid(15, 15, 1, 1);
  const auto half = static_cast<PointId>(mesh.points.size());
  for (PointId i = 0; i < half; ++i) mesh.points.push_back({mesh.points[i][0] + 3, mesh.points[i][1], mesh.points[i][2] + 0.5});
  const std::vector<PointId> corners = mesh.face_points;
  const auto sizes = mesh.face_sizes;
  for (const PointId corner : corners) mesh.face_points.push_back(corner + half);
  mesh.face_sizes.insert(mesh.face_sizes.end(), sizes.begin(), sizes.end());
  for (const auto& [stretching, bending] : {std::pair{1.0, 0.0}, {0.0, 1.0}}) {
    const EnergySpace space = mls_space(mesh, options(stretching, bending, 200), 3);
    EXPECT_NE(space.notes.back().find("2 parts"), std::string::npos);
    std::vector<PointId> held;
    for (PointId i = 0; i < half; ++i) {
      if (mesh.points[i][0] < 0.1 || mesh.points[i][0] > 0.9) held.push_back(i);
    }
    const Eigen::VectorXd moved =
        test::least_energy(space, held, Eigen::VectorXd::Constant(static_cast<Eigen::Index>(held.size()), 0.1));
    EXPECT_LT((moved.array() - 0.1).abs().maxCoeff(), 1e-4);
  }
}

TEST(MlsSpace, WeightsOfRegions) {
  const Mesh mesh = test::flat_grid(40, 10, 4, 1);
  MlsOptions chosen = options(1, 0);
  chosen.weights.push_back({Region{Region::InBox{{2, -1, -1}, {9, 9, 9}}}, 9, 0});
  const EnergySpace space = mls_space(mesh, chosen, 5);
  std::vector<PointId> held;
  for (PointId i = 0; i < 400; ++i) {
    if (mesh.points[i][0] < 0.01 || mesh.points[i][0] > 3.99) held.push_back(i);
  }
  Eigen::VectorXd prescribed(static_cast<Eigen::Index>(held.size()));
  for (std::size_t i = 0; i < held.size(); ++i) prescribed[static_cast<Eigen::Index>(i)] = mesh.points[held[i]][0] / 4;
  const Eigen::VectorXd moved = test::least_energy(space, held, prescribed);
  // Two springs in a row, one nine times as stiff: 0.9 of the way at the joint.
  for (PointId i = 0; i < 400; ++i) {
    const double x = mesh.points[i][0], expected = x < 2 ? 0.45 * x : 0.9 + 0.05 * (x - 2);
    EXPECT_NEAR(moved[i], expected, 0.03) << x;
  }
}

TEST(MlsSpace, SpaceAroundASurface) {
  const Mesh body = ahmed_body({.target_points = 2000});
  const EnergySpace space = mls_space(body, options(0, 1, 300, 200), 2);
  EXPECT_EQ(space.samples, 500u);
  expect_positions(body, space, 1e-10);
  const auto bend = [](double x, double y, double z) { return x * x + 0.5 * y * z; };
  EXPECT_GT(energy(space, at_samples(space, bend)), 0);
}

TEST(MlsSpace, EstimateIsAnUpperBound) {
  for (const auto& [mesh, chosen] :
       {std::pair{test::thesis_plane(), options(1, 1, 500)}, {test::solid_cube(6), options(1, 1, 300, 200)}}) {
    const SpaceBytes bytes = estimate_mls_space(mesh, chosen);
    const EnergySpace space = mls_space(mesh, chosen, 1);
    constexpr std::size_t entry = 16;
    const auto values = static_cast<std::size_t>(space.values.nonZeros()),
               entries = static_cast<std::size_t>(space.energy.nonZeros());
    EXPECT_GE(bytes.energy_entries, entries);
    EXPECT_GE(bytes.resident, entry * (values + entries));
    EXPECT_LE(bytes.resident, 8 * entry * (values + entries));
    EXPECT_GT(bytes.peak, bytes.resident);
    EXPECT_EQ(bytes.samples, space.samples);
  }
}

TEST(MlsSpace, BadInputAndCancelling) {
  Mesh point;
  point.points = {{1, 2, 3}, {1, 2, 3}};
  test::expect_error(ErrorCode::invalid_argument, {"mesh", "no extent"}, [&] { mls_space(point, {}, 1); });
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  test::expect_error(ErrorCode::cancelled, {}, [&] { mls_space(test::thesis_plane(), {}, 1, context); });
}

TEST(MeshPieces, MeasuresOfEveryKindOfCell) {
  const Mesh cube = test::solid_cube(3);
  const CellPieces cells(cube, cube.points);
  double sum = 0;
  for (std::size_t c = 0; c < cells.count(); ++c) {
    sum += cells.measure(c);
    const Vec3 x = cells.place(c, {0.3, 0.6, 0.9});
    const auto nodes = cube.elements->nodes(c);
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_GE(x[k], cube.points[nodes[0]][k]);
      EXPECT_LE(x[k], cube.points[nodes[6]][k]);
    }
  }
  EXPECT_NEAR(sum, 1, 1e-12);
  const FacePieces faces(cube, cube.points);
  double area = 0;
  for (std::size_t f = 0; f < faces.count(); ++f) area += faces.measure(f);
  EXPECT_NEAR(area, 6, 1e-12);
}

}  // namespace
}  // namespace deform::mls_space_test
