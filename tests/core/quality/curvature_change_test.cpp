// SPDX-License-Identifier: GPL-3.0-or-later
// The part of a change of curvature that is not smooth, against the definition point by point.
#include "core/quality/curvature_change.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::curvature_change_test {
namespace {

MeanCurvature curvature_of(const Mesh& mesh) { return mean_curvature(mesh, Adjacency(mesh)); }

template <typename Place>
Mesh moved(Mesh mesh, const Place& place) {
  for (Vec3& p : mesh.points) p = place(p);
  return mesh;
}

CurvatureChange change_between(const Mesh& before, const Mesh& after) {
  return curvature_change(before, curvature_of(before), curvature_of(after));
}

/// Ripples of amplitude a on a sphere, around the z axis.
Mesh rippled(const Mesh& mesh, double a, int waves) {
  return moved(mesh, [&](const Vec3& p) {
    const double s = 1 + a * std::sin(waves * std::atan2(p[1], p[0])) * (p[0] * p[0] + p[1] * p[1]);
    return Vec3{s * p[0], s * p[1], s * p[2]};
  });
}

TEST(CurvatureChange, IsTheSumOfWhatPointsDifferFromTheirNeighbours) {
  const Mesh before = test::sphere(1, 3), after = rippled(before, 0.02, 6);
  const MeanCurvature h0 = curvature_of(before), h1 = curvature_of(after);
  const CurvatureChange change = curvature_change(before, h0, h1);
  double energy = 0, largest = 0;
  for (PointId i = 0; i < before.point_count(); ++i) {
    std::set<PointId> ring;
    for (std::size_t c = 0; c < before.face_points.size(); ++c) {
      const std::size_t first = c - c % 3;
      if (before.face_points[c] != i) continue;
      for (std::size_t k = 0; k < 3; ++k) ring.insert(before.face_points[first + k]);
    }
    ring.erase(i);
    double mean = 0;
    for (const PointId j : ring) mean += (h1.value[j] - h0.value[j]) / static_cast<double>(ring.size());
    const double own = h1.value[i] - h0.value[i];
    EXPECT_DOUBLE_EQ(change.value[i], own);
    energy += h0.area[i] * (own - mean) * (own - mean);
    largest = std::max(largest, std::abs(own));
  }
  EXPECT_NEAR(change.high_pass_energy, energy, 1e-12 * energy);
  EXPECT_EQ(std::abs(change.largest.value), largest);
  EXPECT_EQ(change.points, before.point_count());
}

TEST(CurvatureChange, ShortRipplesHaveMoreThanLongOnes) {
  const Mesh sphere = test::sphere(1, 4);
  const double none = change_between(sphere, rippled(sphere, 0, 3)).high_pass_energy;
  const double little = change_between(sphere, rippled(sphere, 0.01, 3)).high_pass_energy;
  const double much = change_between(sphere, rippled(sphere, 0.01, 12)).high_pass_energy;
  EXPECT_EQ(none, 0);
  EXPECT_GT(much, 30 * little);
}

TEST(CurvatureChange, HasNoUnitAndIsNothingForRigidMotions) {
  const Mesh before = test::sphere(1, 3), after = rippled(before, 0.02, 6);
  const auto large = [](const Vec3& p) { return Vec3{1000 * p[0], 1000 * p[1], 1000 * p[2]}; };
  const double energy = change_between(before, after).high_pass_energy;
  EXPECT_NEAR(change_between(moved(before, large), moved(after, large)).high_pass_energy, energy, 1e-9 * energy);
  const auto turned = [](const Vec3& p) { return Vec3{p[1] + 3, -p[0], p[2] - 7}; };
  EXPECT_LT(change_between(before, moved(before, turned)).high_pass_energy, 1e-20);
}

TEST(CurvatureChange, LeavesOutSharpEdgesAndBoundaries) {
  // A roof: two planes that meet at an angle along j = 2, bent further.
  const auto roof = [](double slope) {
    return test::sheet(4, 4, test::Faces::quads, [slope](unsigned i, unsigned j) {
      return Vec3{1.0 * i, 1.0 * j, -slope * std::abs(static_cast<int>(j) - 2)};
    });
  };
  const CurvatureChange sharp = change_between(roof(0.5), roof(0.6)), blunt = change_between(roof(0.2), roof(0.6));
  std::set<std::size_t> with, inside;
  for (std::size_t i = 0; i < 25; ++i) {
    if (!std::isnan(sharp.value[i])) with.insert(i);
    if (!std::isnan(blunt.value[i])) inside.insert(i);
  }
  EXPECT_EQ(inside, (std::set<std::size_t>{6, 7, 8, 11, 12, 13, 16, 17, 18})) << "23 degrees";
  EXPECT_EQ(with, (std::set<std::size_t>{6, 7, 8, 16, 17, 18})) << "53 degrees along 10 to 14";
  EXPECT_GT(blunt.high_pass_energy, 0);
  EXPECT_LT(sharp.high_pass_energy, 1e-20);
  Mesh turned_over = roof(0.5);
  for (std::size_t f = 0; f < 4; ++f) std::swap(turned_over.face_points[4 * f + 1], turned_over.face_points[4 * f + 3]);
  Mesh after = turned_over;
  after.points = roof(0.6).points;
  const CurvatureChange same = change_between(turned_over, after);
  for (std::size_t i = 0; i < 25; ++i) {
    EXPECT_EQ(std::isnan(same.value[i]), std::isnan(sharp.value[i])) << i << ": the first row of faces is upside down";
  }
}

TEST(CurvatureChange, RefusesOtherNumbersOfPoints) {
  const Mesh mesh = test::sphere(1, 1);
  const MeanCurvature right = curvature_of(mesh), wrong = curvature_of(test::sphere(1, 2));
  test::expect_error(ErrorCode::invalid_argument, {"before", "66", "18"}, [&] { curvature_change(mesh, wrong, right); });
  test::expect_error(ErrorCode::invalid_argument, {"after", "66", "18"}, [&] { curvature_change(mesh, right, wrong); });
}

}  // namespace
}  // namespace deform::curvature_change_test
