// SPDX-License-Identifier: GPL-3.0-or-later
// What thesis 7.2 is compared with in volume_bench and volume_rows_test must be right itself.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "tests/bench/harmonic_baseline.h"
#include "tests/core/deformers/block_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::harmonic_baseline_test {
namespace {

using bench::HarmonicBaseline;

/// Six tetrahedra around the diagonal of every hexahedron.
Elements tetrahedra_of(const Elements& hexahedra) {
  Elements result;
  constexpr std::size_t around[] = {1, 2, 3, 7, 4, 5};
  for (std::size_t e = 0; e < hexahedra.size(); ++e) {
    const auto nodes = hexahedra.nodes(e);
    for (std::size_t k = 0; k < 6; ++k) {
      const PointId tetrahedron[] = {nodes[0], nodes[around[k]], nodes[around[(k + 1) % 6]], nodes[6]};
      result.add(ElementType::tetrahedron, tetrahedron);
    }
  }
  return result;
}

std::vector<PointId> boundary_of(const Mesh& mesh) {
  std::vector<PointId> ids = mesh.face_points;
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  return ids;
}

// The patch test: linear fields are harmonic in any mesh, and linear elements hold them exactly.
TEST(HarmonicBaseline, ReproducesLinearFields) {
  test::Cube cube = test::cube(5);
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform(-0.03, 0.03);
  for (Vec3& x : cube.mesh.points) {
    for (double& value : x) value += uniform(random);
  }
  const std::vector<PointId> boundary = boundary_of(cube.mesh);
  const Affine map{1.1, 0.2, 0, 0.3, -0.1, 0.9, 0.2, 0, 0.05, 0, 1.2, -0.5};
  std::vector<Vec3> displacements;
  for (const PointId id : boundary) {
    const Vec3 &x = cube.mesh.points[id], y = transformed(map, x);
    displacements.push_back({y[0] - x[0], y[1] - x[1], y[2] - x[2]});
  }
  for (const Elements& elements : {cube.elements, tetrahedra_of(cube.elements)}) {
    const Points points = HarmonicBaseline(cube.mesh.points, elements, boundary).deformed(displacements);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vec3 expected = transformed(map, cube.mesh.points[i]);
      for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(points[i][k], expected[k], 1e-12) << i;
    }
  }
}

// x^2 - y^2 is harmonic: the error falls with the square of the spacing (rounding of the trilinear form leaves none at nodes of
// a regular grid).
TEST(HarmonicBaseline, SolvesLaplacesEquation) {
  const test::Cube cube = test::cube(6);
  const std::vector<PointId> boundary = boundary_of(cube.mesh);
  const auto field = [](const Vec3& x) { return Vec3{x[0] * x[0] - x[1] * x[1], x[1] * x[2], x[0]}; };
  std::vector<Vec3> displacements;
  for (const PointId id : boundary) displacements.push_back(field(cube.mesh.points[id]));
  const Points points = HarmonicBaseline(cube.mesh.points, cube.elements, boundary).deformed(displacements);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 &x = cube.mesh.points[i], u = field(x);
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(points[i][k] - x[k], u[k], 1e-12) << i;
  }
}

TEST(HarmonicBaseline, RefusesWhatItDoesNotKnow) {
  const test::Cube cube = test::cube(2);
  Elements prism;
  prism.add(ElementType::prism, std::vector<PointId>{0, 1, 3, 9, 10, 12});
  test::expect_error(ErrorCode::invalid_argument, {"prism"}, [&] { HarmonicBaseline(cube.mesh.points, prism, {}); });
  const std::vector<PointId> beyond{27};
  test::expect_error(ErrorCode::invalid_argument, {"boundary[0]: 27 is out of range 0..26"},
                     [&] { HarmonicBaseline(cube.mesh.points, cube.elements, beyond); });
}

}  // namespace
}  // namespace deform::harmonic_baseline_test
