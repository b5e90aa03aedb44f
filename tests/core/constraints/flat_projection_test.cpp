// SPDX-License-Identifier: GPL-3.0-or-later
// Constraints along a plane that no axis is aligned with: the gradient of the other constraint's energy, by differences.
#include "core/constraints/flat_projection.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "core/base/vectors.h"
#include "core/constraints/constraint.h"
#include "core/constraints/matched_shape.h"
#include "tests/core/constraints/projection_checks.h"

namespace deform::flat_projection_test {
namespace {

using namespace test;

const Vec3 oblique{2.0 / 3, -1.0 / 3, 2.0 / 3};

Points in_plane(Points directions) {
  for (Vec3& d : directions) d = d - dot(oblique, d) * oblique;
  return directions;
}

TEST(FlatProjection, IsTheGradientOfTheEnergyAlongThePlane) {
  const Points rest = normal_noise(12, 3), x = along(rest, 0.2, in_plane(normal_noise(12, 4)));
  const FlatProjection flat(matched_projection(rest, Match::rigid), oblique, rest);
  const Projected at = projected(flat, x);
  EXPECT_GT(at.energy, 0.1);
  for (std::size_t i = 0; i < x.size(); ++i) EXPECT_NEAR(dot(oblique, at.points[i]), dot(oblique, rest[i]), 1e-14);
  const Points residual = along(x, -1, at.points);
  const Points u = in_plane(normal_noise(12, 5)), v = in_plane(normal_noise(12, 6));
  constexpr double h = 1e-5;
  const Projected above = projected(flat, along(x, h, u), at.shape), below = projected(flat, along(x, -h, u), at.shape);
  EXPECT_NEAR((above.energy - below.energy) / (4 * h), test::dot(residual, u), 1e-8);
  Points change(x.size()), other(x.size());
  flat.derivative(x, at.shape, u, change);
  flat.derivative(x, at.shape, v, other);
  EXPECT_LT(largest(change, along(along(Points(x.size()), 0.5 / h, above.points), -0.5 / h, below.points)), 1e-8);
  EXPECT_NEAR(test::dot(change, v), test::dot(other, u), 1e-12);
  Points across(x.size(), oblique);
  flat.derivative(x, at.shape, across, change);
  EXPECT_LT(largest(change, Points(x.size())), 1e-14) << "nothing moves that way";
  const Linearization rows = flat.linearize(x, at.shape);
  EXPECT_NEAR(rows.residual.squaredNorm(), at.energy, 1e-12);
  Points sums(x.size());
  for (std::size_t r = 0; r < rows.normals.size(); ++r) {
    sums[r / rows.rows_per_point] = sums[r / rows.rows_per_point] + rows.residual[static_cast<Eigen::Index>(r)] * rows.normals[r];
  }
  EXPECT_LT(largest(sums, residual), 1e-12);
}

TEST(FlatProjection, TellsDistancesInSpace) {
  // A plane at 45 degrees to the one of the points.
  const Points x{{1, 0, 0}, {3, 1, 0}};
  const double s = std::sqrt(0.5);
  const std::vector<std::vector<Vec3>> regions{x};
  const FlatProjection flat(make_projection(FixedPlane{{0, 0, 0}, {s, 0, s}}, regions, {{0, 0, 0}, 1}, "constraints[0]"),
                            {0, 0, 1}, x);
  const Projected at = projected(flat, x);
  EXPECT_NEAR(at.points[1][0], 3 - 3 * s * s, 1e-15);
  EXPECT_EQ(at.points[1][2], 0);
  EXPECT_NEAR(flat.misfit(x, at.points).largest, 3 * s, 1e-14);
}

}  // namespace
}  // namespace deform::flat_projection_test
