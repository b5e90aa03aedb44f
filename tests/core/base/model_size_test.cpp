// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/model_size.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace deform::model_size_test {
namespace {

/// In a box of 2 x 1 x 0.5 at (5, -3, 100).
std::vector<Vec3> body(std::size_t count) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < count; ++i)
    points.push_back({5 + 2 * uniform(random), uniform(random) - 3, 100 + 0.5 * uniform(random)});
  return points;
}

TEST(ModelSize, TellsStrayPointsFromAMillionTimesTheBodyOn) {
  for (const std::size_t count : {200u, 5000u, 350'000u}) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (const double far : {-1e15, -1e8, 1e3, 1e5, 3e6, 1e15, 1e40}) {
        std::vector<Vec3> points = body(count);
        EXPECT_EQ(model_size(points).stray, "");
        points[count / 3][axis] = far;
        // Nine tenths of each side.
        const double ratio = std::abs(far) / (0.9 * std::hypot(2, 1, 0.5));
        EXPECT_EQ(model_size(points).stray.empty(), ratio < 1e6) << count << " " << axis << " " << far;
      }
    }
  }
}

TEST(ModelSize, IsThatOfMostPoints) {
  std::vector<Vec3> points = body(10'000);
  points.back() = {0, 1e15, 0};
  EXPECT_EQ(model_size(points).stray.rfind("most points lie within 2.0", 0), 0u) << model_size(points).stray;
  EXPECT_NE(model_size(points).stray.find("but the bounding box is 1e+15 long"), std::string::npos);
  EXPECT_NEAR(model_size(points).judged_by, 0.9 * std::hypot(2, 1, 0.5), 0.03);
  points.pop_back();
  EXPECT_EQ(model_size(points).judged_by, bounding_box(points).diagonal());
  points.resize(50);
  points.back() = {0, 1e15, 0};
  EXPECT_EQ(model_size(points).judged_by, bounding_box(points).diagonal()) << "too few";
}

TEST(ModelSize, KnowsPlanesLinesAndFewPoints) {
  std::vector<Vec3> plane = body(1000), line = body(1000);
  for (Vec3& x : plane) x[2] = 0;
  for (Vec3& x : line) x[1] = x[2] = 0;
  EXPECT_EQ(model_size(plane).stray, "");
  EXPECT_EQ(model_size(line).stray, "");
  EXPECT_EQ(model_size(std::vector<Vec3>{{0, 0, 0}, {1, 0, 0}, {1e12, 0, 0}}).stray, "");
  EXPECT_EQ(model_size(std::vector<Vec3>(500, Vec3{1, 2, 3})).stray, "") << "their box has no size";
}

/// Layers of cells on a wing and a boundary a thousand chords away.
TEST(ModelSize, TakesTheFarFieldForThePartOfTheModelThatItIs) {
  std::vector<Vec3> points;
  for (int ring = 0; ring < 60; ++ring) {
    const double radius = 0.5 + 1e-7 * std::pow(1.5, ring);
    for (int i = 0; i < 200; ++i) {
      const double angle = 2 * 3.14159265358979 * i / 200;
      points.push_back({radius * std::cos(angle), radius * std::sin(angle), 0});
    }
  }
  EXPECT_EQ(model_size(points).stray, "");
}

}  // namespace
}  // namespace deform::model_size_test
