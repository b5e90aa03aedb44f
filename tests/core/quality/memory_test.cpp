// SPDX-License-Identifier: GPL-3.0-or-later
// What checks say of their memory against what is allocated: servers set it aside before they make a check or call it.
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/mesh/elements.h"
#include "core/quality/displacement_fields.h"
#include "core/quality/face_intersections.h"
#include "core/quality/flipped_faces.h"
#include "core/quality/safe_amplitude.h"
#include "tests/core/quality/cell_shapes.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/counted_allocations.h"

namespace deform::memory_test {
namespace {

using test::CountedAllocations;

constexpr double few_bytes = 5'000;

RunContext one_thread() {
  RunContext context;
  context.threads = 1;
  return context;
}

/// `told` bounds what is taken, and is at most so many times as much.
void expect_bound(const char* what, std::size_t told, std::size_t taken, double most) {
  EXPECT_GE(static_cast<double>(told), 0.98 * static_cast<double>(taken) - few_bytes) << what;
  EXPECT_LE(static_cast<double>(told), most * static_cast<double>(taken) + few_bytes) << what;
}

/// Bent and twisted more and more.
Points bent(const Points& rest, double by) {
  Points moved = rest;
  for (Vec3& x : moved)
    x = {x[0] + by * std::sin(0.4 * x[1]), x[1] + by * std::cos(0.3 * x[2]) * x[0], x[2] - by * x[0] * x[1] / 8};
  return moved;
}

TEST(Memory, OfInversionChecks) {
  const test::Grid g = test::grid(12, 12, 12);
  Elements cubes, tetrahedra;
  for (PointId c = 0; c < 1728; ++c) {
    const PointId a = c % 12 + 13 * (c / 12 % 12 + 13 * (c / 144)), up = 13 * 13;
    const PointId nodes[] = {a, a + 1, a + 14, a + 13, a + up, a + up + 1, a + up + 14, a + up + 13};
    cubes.add(ElementType::hexahedron, nodes);
    const PointId corner[] = {nodes[0], nodes[1], nodes[3], nodes[4]};
    tetrahedra.add(ElementType::tetrahedron, corner);
  }
  struct Cells {
    const char* name;
    CellSet cells;
  };
  for (const Cells& tested : {Cells{"polyhedra", &g.cells}, Cells{"hexahedra", &cubes}, Cells{"tetrahedra", &tetrahedra}}) {
    SCOPED_TRACE(tested.name);
    InversionCheck(g.points, tested.cells, one_thread());
    const CountedAllocations counted;
    const InversionCheck check(g.points, tested.cells, one_thread());
    const std::size_t kept = counted.kept(), making = counted.most();
    expect_bound("bytes_to_make", InversionCheck::bytes_to_make(tested.cells, g.points.size()), making, 4);
    Points mirrored = g.points;
    for (Vec3& x : mirrored) x[0] = -x[0];
    // No cell is inverted, some are, and all.
    for (const Points& moved : {bent(g.points, 0.01), bent(g.points, 0.3), mirrored}) {
      const CountedAllocations calling;
      check.amplitude(g.points, moved, one_thread());
      expect_bound("bytes_for", InversionCheck::bytes_for(tested.cells, g.points.size()), kept + calling.most(), 1.8);
    }
  }
}

/// The coordinates of the points, and 1.
class LinearFields : public DisplacementFields {
 public:
  explicit LinearFields(const Points& points) : points_(points) {}
  std::size_t count() const override { return 4; }
  void values(std::size_t first, std::size_t count, std::span<double> values, const RunContext& /*context*/) const override {
    for (std::size_t i = 0; i < points_.size(); ++i) {
      for (std::size_t k = 0; k < count; ++k) values[i * count + k] = first + k < 3 ? points_[i][first + k] : 1;
    }
  }
  double error(std::size_t /*field*/) const override { return 0; }

 private:
  const Points& points_;
};

TEST(Memory, OfInversionChecksOfFields) {
  const test::Grid g = test::grid(12, 12, 12);
  const LinearFields fields(g.points);
  InversionCheck(g.points, &g.cells, fields, one_thread());
  const CountedAllocations counted;
  const InversionCheck check(g.points, &g.cells, fields, one_thread());
  const std::size_t kept = counted.kept();
  expect_bound("bytes_to_make", InversionCheck::bytes_to_make(&g.cells, g.points.size(), 4), counted.most(), 3);
  FieldMotion motion;
  motion.coefficients = {{0.1, 0, 0.05}, {0, 0.1, 0.02}, {0, 0.02, 0.1}, {1, 2, 3}};
  motion.uncertainties.assign(4, 1e-12);
  motion.rounding = 1e-12;
  Points moved = g.points;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const Vec3& x = g.points[i];
    for (std::size_t k = 0; k < 3; ++k) {
      moved[i][k] += motion.coefficients[3][k];
      for (std::size_t f = 0; f < 3; ++f) moved[i][k] += x[f] * motion.coefficients[f][k];
    }
  }
  const CountedAllocations calling;
  const SafeAmplitude safe = check.amplitude(moved, motion, one_thread());
  expect_bound("bytes_for", InversionCheck::bytes_for(&g.cells, g.points.size(), 4), kept + calling.most(), 2);
  EXPECT_EQ(safe.inverted.count, 0u);
}

TEST(Memory, OfSurfaceChecks) {
  const Mesh mesh = test::sphere(1, 4);
  {
    FlipCheck(mesh, mesh.points, one_thread());
    const CountedAllocations counted;
    const FlipCheck check(mesh, mesh.points, one_thread());
    expect_bound("flip bytes", check.bytes(), counted.kept(), 1.02);
    expect_bound("flip bytes_for", FlipCheck::bytes_for(mesh), counted.most(), 2);
    for (const double by : {0.01, 0.3, 2.0, 20.0}) {
      const Points moved = bent(mesh.points, by);
      const CountedAllocations calling;
      check.flipped(moved, one_thread());
      expect_bound("flip call_bytes", check.call_bytes(), calling.most(), by == 2 ? 1.7 : 20);
    }
  }
  IntersectionCheck(mesh, mesh.points, one_thread());
  const CountedAllocations counted;
  const IntersectionCheck check(mesh, mesh.points, one_thread());
  expect_bound("cross bytes", check.bytes(), counted.kept(), 1.2);
  expect_bound("cross bytes_for", IntersectionCheck::bytes_for(mesh), counted.most(), 13);
  for (const double by : {0.01, 0.3, 2.0, 20.0}) {
    const Points moved = bent(mesh.points, by);
    const CountedAllocations calling;
    check.appeared(moved, one_thread());
    expect_bound("cross call_bytes", check.call_bytes(), calling.most(), 1.4);
  }
}

}  // namespace
}  // namespace deform::memory_test
