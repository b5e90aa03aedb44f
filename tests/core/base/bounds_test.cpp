// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/bounds.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace deform::bounds_test {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

TEST(Bounds, TakeWhatFloatsMakeOfThem) {
  EXPECT_EQ(within_bounds(static_cast<double>(0.1f), -0.1, 0.1), 0.1);
  EXPECT_EQ(within_bounds(static_cast<double>(-0.1f), -0.1, 0.1), -0.1);
  // One step further, as sums in float32 end.
  EXPECT_EQ(within_bounds(static_cast<double>(std::nextafter(0.3f, 1.0f)), -infinity, 0.3), 0.3);
  EXPECT_EQ(within_bounds(static_cast<double>(std::nextafter(-1000.1f, -2000.0f)), -1000.1, infinity), -1000.1);
}

TEST(Bounds, TakeAMillionthOfTheRange) {
  EXPECT_EQ(within_bounds(1 + 1.9e-6, -1, 1), 1);
  EXPECT_EQ(within_bounds(1 + 2.1e-6, -1, 1), std::nullopt);
  EXPECT_EQ(within_bounds(-1e-6, 0, 1), 0);
  EXPECT_EQ(within_bounds(-1.1e-6, 0, 1), std::nullopt);
}

TEST(Bounds, LeaveWhatIsInside) {
  EXPECT_EQ(within_bounds(0.1, -0.1, 0.1), 0.1);
  EXPECT_EQ(within_bounds(0.09999999, -0.1, 0.1), 0.09999999);
  EXPECT_EQ(within_bounds(1e300, -infinity, infinity), 1e300);
}

TEST(Bounds, RefuseTheRest) {
  EXPECT_EQ(within_bounds(0.11, -0.1, 0.1), std::nullopt);
  EXPECT_EQ(within_bounds(-1e-9, 0, infinity), std::nullopt) << "an infinite range has no millionth";
  EXPECT_EQ(within_bounds(1e-9, 0, 0), std::nullopt);
  EXPECT_EQ(within_bounds(std::nan(""), -1, 1), std::nullopt);
  EXPECT_EQ(within_bounds(infinity, -1, 1), std::nullopt);
}

}  // namespace
}  // namespace deform::bounds_test
