// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/vectors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace deform::vectors_test {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

TEST(Vectors, AreAddedAndScaledCoordinateByCoordinate) {
  const Vec3 a{1, 2, 3}, b{10, -20, 40};
  EXPECT_EQ(a + b, (Vec3{11, -18, 43}));
  EXPECT_EQ(a - b, (Vec3{-9, 22, -37}));
  EXPECT_EQ(2 * a, (Vec3{2, 4, 6}));
  EXPECT_EQ(b / 10, (Vec3{1, -2, 4}));
  EXPECT_EQ(lerp(a, b, 0), a);
  EXPECT_EQ(lerp(a, b, 0.5), (Vec3{5.5, -9, 21.5}));
}

TEST(Vectors, HaveDotAndCrossProducts) {
  const Vec3 x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};
  EXPECT_EQ(cross(x, y), z);
  EXPECT_EQ(cross(y, z), x);
  EXPECT_EQ(cross(z, x), y);
  EXPECT_EQ(dot(Vec3{1, 2, 3}, Vec3{4, -5, 6}), 12);
}

TEST(Vectors, SumInTheOrderOfTheAxes) {
  const Vec3 ones{1, 1, 1};
  EXPECT_EQ(dot(Vec3{1e16, 1, -1e16}, ones), 0) << "(1e16 + 1) - 1e16";
  EXPECT_EQ(dot(Vec3{1e16, -1e16, 1}, ones), 1);
}

TEST(Vectors, HaveLengthsAndDistances) {
  EXPECT_EQ(length({2, 3, 6}), 7);
  EXPECT_EQ(norm({2, 3, 6}), 7);
  EXPECT_EQ(distance({1, 1, 1}, {3, 4, 7}), 7);
  EXPECT_EQ(squared_distance({1, 1, 1}, {3, 4, 7}), 49);
  EXPECT_DOUBLE_EQ(norm({3e200, 0, 4e200}), 5e200) << "whose square is infinite";
  EXPECT_DOUBLE_EQ(norm({3e-200, 0, 4e-200}), 5e-200) << "whose square is 0";
  EXPECT_EQ(norm({0, 0, 0}), 0);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Vec3& a : {Vec3{nan, 0, 0}, Vec3{0, nan, 0}, Vec3{0, 0, nan}, Vec3{1, nan, 2}}) EXPECT_TRUE(std::isnan(norm(a)));
}

TEST(Vectors, AreFiniteWhenAllCoordinatesAre) {
  EXPECT_TRUE(is_finite({1e308, 1e308, 1e308}));
  EXPECT_FALSE(is_finite({0, infinity, 0}));
  EXPECT_FALSE(is_finite({0, 0, std::numeric_limits<double>::quiet_NaN()}));
}

}  // namespace
}  // namespace deform::vectors_test
