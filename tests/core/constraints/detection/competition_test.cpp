// SPDX-License-Identifier: GPL-3.0-or-later
// Regions that compete for faces: every face goes to the shape that it lies on, whatever the labels were before.
#include "core/constraints/detection/competition.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

namespace deform::competition_test {
namespace {

using detection::Limits;
using detection::Region;
using detection::Segmentation;
using detection::Shape;
using detection::Surface;
using detection::unlabelled;
using detection::Vector3d;

constexpr int columns = 12, rows = 10;

/// A sheet of quadrilaterals over 1.2 x 1 that bends upwards by these angles (radians) at x = 0.4 and x = 0.8: three planes.
struct Folded {
  Mesh mesh;
  Surface surface;
  Limits limits;
  std::vector<std::uint32_t> truth;  ///< the plane of each face

  Folded(double first, double second) {
    const double along[] = {0, first, first + second};
    for (int j = 0; j <= rows; ++j) {
      double x = 0, z = 0;
      for (int i = 0; i <= columns; ++i) {
        mesh.points.push_back({x, 0.1 * j, z});
        const double angle = along[std::min(i / 4, 2)];
        x += 0.1 * std::cos(angle);
        z += 0.1 * std::sin(angle);
      }
    }
    for (PointId j = 0; j < rows; ++j) {
      for (PointId i = 0; i < columns; ++i) {
        const PointId a = j * (columns + 1) + i;
        mesh.face_sizes.push_back(4);
        mesh.face_points.insert(mesh.face_points.end(), {a, a + 1, a + columns + 2, a + columns + 1});
        truth.push_back(i / 4);
      }
    }
    surface = Surface(mesh, {});
    surface.find_passages(0.6);
    limits.tolerance = 0.02;
    limits.floor = 0.0005;
    limits.maximum_angle = 0.6;
    limits.minimum_area = surface.total_area / 20;
    limits.kinds = {PrimitiveKind::plane, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::cone};
  }

  /// The true planes with these labels.
  Segmentation with(std::vector<std::uint32_t> labels) const {
    Segmentation result;
    result.labels = std::move(labels);
    for (std::uint32_t plane = 0; plane < 3; ++plane) {
      const std::size_t face = 4 * plane + 1;  // in the first row
      Region region;
      region.shape.point = surface.centre[face];
      region.shape.axis = surface.normal[face];
      result.regions.push_back(region);
    }
    return result;
  }

  void expect_truth(const Segmentation& found) const {
    ASSERT_EQ(found.regions.size(), 3u);
    EXPECT_EQ(found.labels, truth);
    for (std::uint32_t plane = 0; plane < 3; ++plane) {
      const Region& region = found.regions[plane];
      EXPECT_EQ(region.faces.size(), 40u);
      for (const FaceId f : region.faces) EXPECT_EQ(truth[f], plane);
      EXPECT_NEAR(region.area, surface.total_area / 3, 1e-12);
      EXPECT_LE(region.rms, 1e-12);
      EXPECT_NEAR(std::abs(region.shape.axis.dot(surface.normal[4 * plane])), 1, 1e-12);
    }
  }
};

TEST(Competition, EveryFaceGoesToItsPlane) {
  const Folded sheet(0.3, -0.2);
  Segmentation right = sheet.with(sheet.truth);
  compete(sheet.surface, sheet.limits, right, {});
  sheet.expect_truth(right);
  // A column beyond each fold, and one face in the middle of another plane.
  std::vector<std::uint32_t> labels = sheet.truth;
  for (std::size_t j = 0; j < rows; ++j) labels[j * columns + 4] = 0, labels[j * columns + 7] = 2;
  labels[5 * columns + 1] = 1;
  Segmentation wrong = sheet.with(labels);
  compete(sheet.surface, sheet.limits, wrong, {});
  sheet.expect_truth(wrong);
  // Some of no region: a column, and a face inside.
  labels = sheet.truth;
  for (std::size_t j = 0; j < rows; ++j) labels[j * columns + 4] = unlabelled;
  labels[5 * columns + 1] = labels[5 * columns + 2] = unlabelled;
  Segmentation some = sheet.with(labels);
  compete(sheet.surface, sheet.limits, some, {});
  sheet.expect_truth(some);
}

// Where the planes are nearly one, distances decide: faces within the tolerance of both go to the closer one.
TEST(Competition, TheCloserOneWins) {
  const Folded sheet(0.04, -0.03);
  std::vector<std::uint32_t> labels = sheet.truth;
  for (std::size_t j = 0; j < rows; ++j) labels[j * columns + 4] = 0, labels[j * columns + 7] = 2;
  Segmentation wrong = sheet.with(labels);
  Limits wide = sheet.limits;
  wide.floor = 0.01;
  compete(sheet.surface, wide, wrong, {});
  sheet.expect_truth(wrong);
}

TEST(Competition, LeavesWhatFitsNothing) {
  const Folded sheet(0.3, -0.2);
  std::vector<std::uint32_t> labels(sheet.truth.size(), unlabelled);
  for (std::size_t f = 0; f < labels.size(); ++f) {
    if (sheet.truth[f] != 1) labels[f] = sheet.truth[f] == 0 ? 0 : 1;
  }
  Segmentation two = sheet.with(labels);
  two.regions.erase(two.regions.begin() + 1);
  compete(sheet.surface, sheet.limits, two, {});
  ASSERT_EQ(two.regions.size(), 2u);
  EXPECT_EQ(two.labels, labels);
}

/// Coplanar squares of n x n faces each, side by side with gaps between them.
Surface squares(std::initializer_list<int> sizes) {
  Mesh mesh;
  double x = 0;
  for (const int n : sizes) {
    const auto first = static_cast<PointId>(mesh.points.size()), across = static_cast<PointId>(n + 1);
    for (int j = 0; j <= n; ++j) {
      for (int i = 0; i <= n; ++i) mesh.points.push_back({x + 0.1 * i, 0.1 * j, 0});
    }
    for (PointId j = 0; j + 1 < across; ++j) {
      for (PointId i = 0; i + 1 < across; ++i) {
        const PointId a = first + j * across + i;
        mesh.face_sizes.push_back(4);
        mesh.face_points.insert(mesh.face_points.end(), {a, a + 1, a + across + 1, a + across});
      }
    }
    x += 0.1 * n + 1;
  }
  Surface surface(mesh, {});
  surface.find_passages(0.6);
  return surface;
}

// Pieces of less than a tenth of the largest one are given up, and regions that are too small; the others keep their order.
TEST(Competition, GivesUpIslandsAndSmallRegions) {
  const Surface surface = squares({10, 4, 3});  // 100, 16 and 9 faces
  Segmentation found;
  found.labels.assign(125, 0);
  found.regions.resize(1);
  Limits limits;
  limits.tolerance = 0.02;
  limits.floor = 0.0005;
  limits.minimum_area = surface.total_area / 20;
  compete(surface, limits, found, {});
  ASSERT_EQ(found.regions.size(), 1u);
  EXPECT_EQ(found.regions[0].faces.size(), 116u);
  for (std::size_t f = 0; f < 125; ++f) EXPECT_EQ(found.labels[f], f < 116 ? 0 : unlabelled) << f;
  Segmentation three;
  three.labels.assign(125, 2);
  std::fill_n(three.labels.begin(), 100, 0);
  std::fill_n(three.labels.begin() + 100, 16, 1);
  three.regions.resize(3);
  limits.minimum_area = surface.total_area * 10 / 125;
  compete(surface, limits, three, {});
  ASSERT_EQ(three.regions.size(), 2u);
  EXPECT_EQ(three.regions[1].faces.size(), 16u);
  for (std::size_t f = 0; f < 125; ++f) EXPECT_EQ(three.labels[f], f < 100 ? 0 : f < 116 ? 1 : unlabelled) << f;
  limits.minimum_area = surface.total_area * 17 / 125;
  compete(surface, limits, three, {});
  ASSERT_EQ(three.regions.size(), 1u);
  limits.minimum_area = surface.total_area * 99.9999999999 / 125;
  compete(surface, limits, three, {});
  EXPECT_EQ(three.regions.size(), 1u);
}

TEST(Competition, HalvesOfOnePlaneAreJoined) {
  const Folded sheet(0.3, -0.2);
  // The first and the last plane in two halves each; the numbers of the halves are not neighbours.
  Segmentation halves;
  halves.labels.resize(sheet.truth.size());
  for (std::uint32_t r = 0; r < 5; ++r) halves.regions.push_back(sheet.with({}).regions[r < 3 ? r : r == 3 ? 0 : 2]);
  for (std::size_t f = 0; f < halves.labels.size(); ++f) {
    const bool upper = f / columns >= rows / 2;
    const std::uint32_t plane = sheet.truth[f];
    halves.labels[f] = plane == 1 || !upper ? plane : plane == 0 ? 3 : 4;
  }
  detection::refit(sheet.surface, halves, std::vector<char>(5, 1), {});
  detection::join_regions(sheet.surface, sheet.limits, halves);
  sheet.expect_truth(halves);
  // Apart, they are two: planes that do not touch are not one.
  Segmentation apart = sheet.with(sheet.truth);
  for (std::size_t f = 0; f < apart.labels.size(); ++f) {
    const std::size_t j = f / columns;
    if (sheet.truth[f] != 0) apart.labels[f] = unlabelled;
    if (sheet.truth[f] == 0 && j >= 4) apart.labels[f] = j >= 6 ? 1 : unlabelled;
  }
  apart.regions = {apart.regions[0], apart.regions[0]};
  detection::refit(sheet.surface, apart, std::vector<char>(2, 1), {});
  const Segmentation before = apart;
  detection::join_regions(sheet.surface, sheet.limits, apart);
  EXPECT_EQ(apart.regions.size(), 2u);
  EXPECT_EQ(apart.labels, before.labels);
}

// Two planes with nearly no fold between them: the one of both is as far from the one as from the other.
TEST(Competition, WhatIsJoinedIsFittedAgain) {
  constexpr double fold = 0.002;
  const Folded sheet(fold, 0.3);
  Segmentation found = sheet.with(sheet.truth);
  detection::refit(sheet.surface, found, std::vector<char>(3, 1), {});
  detection::join_regions(sheet.surface, sheet.limits, found);
  ASSERT_EQ(found.regions.size(), 2u);
  const Region& both = found.regions[0];
  EXPECT_EQ(both.faces.size(), 80u);
  EXPECT_NEAR(both.shape.axis[0] / both.shape.axis[2], -std::tan(fold / 2), 1e-7);
  EXPECT_NEAR(both.shape.axis[1], 0, 1e-9);
  // Half of the height of the fold over the line between its ends, from below and from above.
  const double height = 0.4 * std::sin(fold / 2) / sheet.surface.size;
  for (const PointId p : {0u, 8u}) EXPECT_NEAR(std::abs(both.shape.distance(sheet.surface.points[p])), height / 2, 1e-6);
  EXPECT_NEAR(std::abs(both.shape.distance(sheet.surface.points[4])), height / 2, 1e-6);
}

TEST(Competition, RefitsOnlyWhatHasChanged) {
  const Folded sheet(0.3, -0.2);
  Segmentation found = sheet.with(sheet.truth);
  for (Region& region : found.regions) {
    region.shape.axis = Vector3d::UnitX();
    region.rms = 0.5;
  }
  detection::refit(sheet.surface, found, std::vector<char>{1, 0, 1}, {});
  EXPECT_EQ(found.regions[0].faces.size(), 40u);
  EXPECT_EQ(found.regions[1].faces.size(), 0u);
  EXPECT_EQ(found.regions[1].shape.axis, Vector3d(1, 0, 0));
  EXPECT_EQ(found.regions[1].rms, 0.5);
  EXPECT_NEAR(std::abs(found.regions[2].shape.axis.dot(sheet.surface.normal[8])), 1, 1e-12);
  EXPECT_LE(found.regions[2].rms, 1e-12);
}

}  // namespace
}  // namespace deform::competition_test
