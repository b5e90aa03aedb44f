// SPDX-License-Identifier: GPL-3.0-or-later
// InversionCheck looks at few cells and must answer as if it had looked at all of them.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "core/base/vectors.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/core/quality/cell_by_cell.h"
#include "tests/core/quality/cell_shapes.h"

namespace deform::safe_amplitude_same_test {
namespace {

using namespace test;

constexpr double sizes[] = {0, 1e-3, 0.02, 0.1, 0.3, 1, 3};

/// A smooth motion and a little noise, in units of the mesh, that takes `size` from the middle to the ends.
Points moved(const Points& rest, double size, double unit, std::mt19937_64& random, bool plane = false) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  Vec3 wave{uniform(random), uniform(random), uniform(random)};
  Points points = rest;
  for (Vec3& p : points) {
    const Vec3 x = (1 / unit) * p;
    const double phase = x[0] * wave[0] + x[1] * wave[1] + x[2] * wave[2];
    for (std::size_t k = 0; k < (plane ? 2u : 3u); ++k) {
      p[k] += unit * size * (std::sin(phase + static_cast<double>(k)) + 0.05 * uniform(random));
    }
  }
  return points;
}

void compare(const Points& rest, const CellSet& cells, double unit, std::mt19937_64& random, bool plane = false) {
  const InversionCheck check(rest, cells);
  for (const double size : sizes) {
    SCOPED_TRACE(size);
    const Points to = moved(rest, size, unit, random, plane);
    expect_same(check.amplitude(rest, to), cell_by_cell(rest, rest, to, cells));
    // From elsewhere, where cells may be inverted already.
    const Points from = moved(rest, 0.5 * size, unit, random, plane);
    expect_same(check.amplitude(from, to), cell_by_cell(rest, from, to, cells));
    const Inversions inverted = check.inverted(to), expected = cell_by_cell(rest, rest, to, cells).inverted;
    EXPECT_EQ(inverted.count, expected.count);
    EXPECT_EQ(inverted.least_determinant.value, expected.least_determinant.value);
    EXPECT_EQ(inverted.least_determinant.id, expected.least_determinant.id);
  }
}

Points scaled(Points points, double unit, double height) {
  for (Vec3& p : points) p = {unit * p[0], unit * p[1], unit * height * p[2]};
  return points;
}

/// The cubes of a grid as hexahedra.
Elements hexahedra(PointId n) {
  Elements cubes;
  for (PointId c = 0; c < n * n * n; ++c) {
    const PointId row = n + 1, up = row * row, a = c % n + row * (c / n % n) + up * (c / (n * n));
    const PointId nodes[] = {a, a + 1, a + row + 1, a + row, a + up, a + up + 1, a + up + row + 1, a + up + row};
    cubes.add(ElementType::hexahedron, nodes);
  }
  return cubes;
}

TEST(SafeAmplitudeSame, GridsInAllUnitsAndLayers) {
  const Grid g = grid(4, 4, 4);
  const Elements cubes = hexahedra(4);
  std::mt19937_64 random(11);
  for (const double unit : {1e-3, 1.0, 1e3}) {
    for (const double height : {1.0, 1e-4}) {
      for (const double mirror : {1.0, -1.0}) {
        SCOPED_TRACE(testing::Message() << unit << " x " << height * mirror);
        const Points rest = scaled(shaken(g.points, 0.12, random), unit, height * mirror);
        compare(rest, &g.cells, unit, random);
        compare(rest, &cubes, unit, random);
      }
    }
  }
}

TEST(SafeAmplitudeSame, ElementsOfEveryType) {
  std::mt19937_64 random(13);
  for (std::size_t i = 0; i < element_types; ++i) {
    const auto type = static_cast<ElementType>(i);
    SCOPED_TRACE(shape(type).name);
    const auto [rest, elements] = shaken_elements(type, 300, 7, random);
    compare(rest, &elements, 1, random);
  }
}

TEST(SafeAmplitudeSame, FacesInThePlane) {
  std::mt19937_64 random(17);
  Mesh mesh = quad_grid(20, 20);
  mesh.points = scaled(shaken(mesh.points, 0.2, random), 1, 0);
  compare(mesh.points, &mesh, 1, random, true);
}

// Cells that are inverted, collapsed or bare of faces at rest, and one that keeps its place.
TEST(SafeAmplitudeSame, DegenerateAtRest) {
  std::mt19937_64 random(19);
  Grid g = grid(6, 6, 6);
  Points rest = shaken(g.points, 0.35, random);
  for (std::size_t k = 0; k < 8; ++k) rest[100 + k] = rest[100];
  ++g.cells.cell_count;
  const InversionCheck check(rest, &g.cells);
  EXPECT_GT(check.at_rest().count, 3u);
  EXPECT_LT(check.at_rest().count, 200u);
  compare(rest, &g.cells, 1, random);
}

// Where displacements overflow single precision, and far away from the origin.
TEST(SafeAmplitudeSame, LargeNumbers) {
  std::mt19937_64 random(23);
  const Grid g = grid(5, 5, 5);
  const InversionCheck check(g.points, &g.cells);
  for (const double size : {1e6, 1e20, 1e45}) {
    Points to = g.points;
    for (Vec3& p : to) p[0] += size;
    to[77][1] += size;
    expect_same(check.amplitude(g.points, to), cell_by_cell(g.points, g.points, to, &g.cells));
  }
  Points far = g.points;
  for (Vec3& p : far) p = {p[0] + 1e7, p[1] - 1e7, p[2]};
  compare(far, &g.cells, 1, random);
}

// Small and smooth: nearly all cells are cleared, at the amplitude of inversions most are not.
TEST(SafeAmplitudeSame, FewSuspects) {
  const Grid g = grid(20, 20, 20);
  const InversionCheck check(g.points, &g.cells);
  const auto bent = [&](double by) {
    Points points = g.points;
    for (Vec3& p : points)
      p = {p[0] + by * std::sin(0.3 * p[2]), p[1] + by * std::sin(0.3 * p[0]), p[2] + by * std::cos(0.3 * p[1])};
    return points;
  };
  EXPECT_EQ(check.amplitude(g.points, g.points).suspects, 0u);
  EXPECT_EQ(check.amplitude(g.points, bent(0.3)).suspects, 0u);
  const double most = check.amplitude(g.points, bent(20)).amplitude;
  EXPECT_LT(most, 1);
  EXPECT_LE(check.amplitude(g.points, bent(0.1 * 20 * most)).suspects, 80u);
  EXPECT_GT(check.amplitude(g.points, bent(20)).suspects, 1000u);
}

}  // namespace
}  // namespace deform::safe_amplitude_same_test
