// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/quality/still_faces.h"

#include <gtest/gtest.h>

#include <random>

#include "core/quality/polygon.h"
#include "tests/core/quality/surface_meshes.h"

namespace deform::quality::still_faces_test {
namespace {

double turn(const Vec3& a, const Vec3& b) { return angle_between(a, b) * 180 / std::numbers::pi; }

TEST(StillFaces, HaveTurnedByNoMoreThanIsSaid) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  for (const test::Faces faces : {test::Faces::triangles, test::Faces::quads}) {
    const Mesh mesh = test::sheet(30, 30, faces, [&](std::uint32_t i, std::uint32_t j) {
      return Vec3{i + 0.2 * normal(random), j + 0.2 * normal(random), 0.3 * normal(random)};
    });
    const FaceCorners corners(mesh);
    std::vector<Vec3> normals;
    for (std::size_t f = 0; f < corners.size(); ++f) normals.push_back(unit_normal(mesh.points, corners[f], 0));
    std::vector<FacePair> sharp;  // every second face has one
    for (FaceId f = 0; f < corners.size(); f += 2) sharp.push_back({f, f, 0, 0, 0, 0});
    const StillFaces check(corners, mesh.points, normals, sharp, {});
    for (const double shift : {0.0, 1e5}) {
      std::size_t still = 0, all = 0;
      double largest = 0;
      for (const double amount : {0.02, 0.05, 0.1, 0.2, 0.5}) {
        Points points = mesh.points;
        for (Vec3& p : points) p = p + Vec3{amount * normal(random) + shift, amount * normal(random), amount * normal(random)};
        std::vector<char> moved(corners.size(), 7);
        check.find_moved(corners, mesh.points, points, moved, {});
        for (std::size_t f = 0; f < corners.size(); ++f) {
          ASSERT_TRUE(moved[f] == 0 || moved[f] == 1);
          ++all;
          if (moved[f] == 1) continue;
          ++still;
          const bool near_sharp = f % 2 == 0 && faces == test::Faces::triangles;
          const double turned = turn(normals[f], unit_normal(points, corners[f], 0));
          ASSERT_LE(turned, near_sharp ? 15.0 : 30.0);
          largest = std::max(largest, turned);
          for (std::size_t c = 0; c < 3 && near_sharp; ++c) {
            const PointId a = corners[f][c], b = corners[f][(c + 1) % 3];
            ASSERT_LE(turn(mesh.points[b] - mesh.points[a], points[b] - points[a]), 30);
          }
        }
      }
      EXPECT_GT(still, shift == 0 ? all / 8 : all / 20);
      EXPECT_GT(largest, 4);
    }
  }
}

TEST(StillFaces, WhatIsNoNumberHasMoved) {
  const Mesh mesh = test::sheet(3, 1, test::Faces::triangles, [](std::uint32_t i, std::uint32_t j) {
    return Vec3{double(i), double(j), 0};
  });
  const FaceCorners corners(mesh);
  const std::vector<Vec3> normals(corners.size(), Vec3{0, 0, 1});
  const StillFaces check(corners, mesh.points, normals, {}, {});
  Points points = mesh.points;
  points[0][1] = std::nan("");
  std::vector<char> moved(corners.size());
  check.find_moved(corners, mesh.points, points, moved, {});
  EXPECT_EQ(moved[0], 1);
  EXPECT_EQ(moved[1], 1);
}

}  // namespace
}  // namespace deform::quality::still_faces_test
