// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/quality/displacement.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <limits>

namespace deform::displacement_test {
namespace {

using testing::HasSubstr;

TEST(LargestDisplacement, IsTheFirstOfTheLargest) {
  const Points rest = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}};
  const Points points = {{0, 0, 1}, {1, 3, 4}, {2, 5, 0}, {3, 0, 0}};
  const Extreme largest = largest_displacement(points, rest);
  EXPECT_EQ(largest.value, 5);
  EXPECT_EQ(largest.id, 1u);
  EXPECT_EQ(largest_displacement(rest, rest).value, 0);
  EXPECT_EQ(largest_displacement({}, {}).value, 0);
}

TEST(LargestDisplacement, IsTheLargestAlsoWhereSquaresOverflow) {
  const Points rest = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  const Extreme largest = largest_displacement(Points{{1e200, 0, 0}, {3e299, 4e299, 0}, {-1e250, 0, 0}}, rest);
  EXPECT_DOUBLE_EQ(largest.value, 5e299);
  EXPECT_EQ(largest.id, 1u);
  for (const double gone : {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
    const Extreme lost = largest_displacement(Points{{1e200, 0, 0}, {1, 0, 0}, {2, gone, 0}}, rest);
    EXPECT_EQ(lost.value, std::numeric_limits<double>::infinity());
    EXPECT_EQ(lost.id, 2u);
  }
}

TEST(DisplacementWarning, NamesThePointAndTheRatioFromOneAndAHalfOn) {
  const auto warning = displacement_warning({0.29812, 4711}, 0.104506, 1.1);
  ASSERT_TRUE(warning);
  for (const char* part : {"point 4711 moves 0.298,", "2.9 times", "(0.105)", "folded"}) EXPECT_THAT(*warning, HasSubstr(part));
  EXPECT_NE(displacement_warning({0.29812, 4711}, 0.104506, 1.1)->find("move more of what is around the handles"),
            std::string::npos);
  const auto known = displacement_warning({0.29812, 4711}, 0.104506, 1.1, "the kernel does it");
  EXPECT_TRUE(known->ends_with("stretched there; the kernel does it")) << *known;
  EXPECT_TRUE(displacement_warning({1.5, 0}, 1, 10));
  EXPECT_FALSE(displacement_warning({1.4999, 0}, 1, 10));
}

TEST(DisplacementWarning, NoneForRoundingOrWhereNothingWasTold) {
  EXPECT_FALSE(displacement_warning({1e-10, 0}, 1e-16, 1));
  EXPECT_FALSE(displacement_warning({1, 0}, 0, 1));
  EXPECT_FALSE(displacement_warning({0, 0}, 0, 0));
  EXPECT_TRUE(displacement_warning({1, 0}, 1e-6, 1));
}

TEST(Displacement, warnings_at_other_points_say_how_far_outside_of_the_mesh_they_are) {
  Box box;
  box.add({0, 0, 0});
  box.add({3, 4, 0});
  const auto outside = displacement_warning_elsewhere({2, 7}, {-6, 12, 0}, 0.5, box);
  ASSERT_TRUE(outside);
  EXPECT_EQ(outside->find("point 7 moves 2, 4.0 times the largest prescribed displacement (0.5): it lies 10 (2 D) outside"), 0u)
      << *outside;
  const auto inside = displacement_warning_elsewhere({2, 7}, {1, 1, 0}, 0.5, box);
  ASSERT_TRUE(inside);
  EXPECT_NE(inside->find("folded"), std::string::npos) << *inside;
  EXPECT_FALSE(displacement_warning_elsewhere({0.7, 7}, {-6, 12, 0}, 0.5, box));
}

}  // namespace
}  // namespace deform::displacement_test
