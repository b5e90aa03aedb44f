// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/types.h"

#include <gtest/gtest.h>

namespace deform::types_test {
namespace {

TEST(Affine, ComposeAppliesTheSecondFirst) {
  const Affine turn{0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0};
  const Affine shift{1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0};
  EXPECT_EQ(transformed(compose(turn, shift), Vec3{1, 0, 0}), (Vec3{0, 6, 0}));
  EXPECT_EQ(transformed(compose(shift, turn), Vec3{1, 0, 0}), (Vec3{5, 1, 0}));
}

TEST(Box, EmptyHasNoDiagonal) {
  EXPECT_EQ(Box{}.diagonal(), 0);
  EXPECT_EQ(bounding_box(Points{{0, 0, 0}, {3, 4, 0}}).diagonal(), 5);
}

TEST(Box, HoldsThePointsAndNoMore) {
  const Points points{{1, 5, -2}, {0, 7, 3}, {-40, 0, 90}};
  const std::vector<PointId> ids{0, 1};
  const Box box = bounding_box(points, ids);
  EXPECT_EQ(box.min, (Vec3{0, 5, -2}));
  EXPECT_EQ(box.max, (Vec3{1, 7, 3}));
  EXPECT_EQ(box.side(1), 2);
  EXPECT_EQ(box.longest_axis(), 2);
  EXPECT_EQ(bounding_box(points).longest_axis(), 2);
  EXPECT_EQ(bounding_box(Points{{0, 0, 0}, {2, 2, 2}}).longest_axis(), 0) << "the first of equal ones";
}

}  // namespace
}  // namespace deform::types_test
