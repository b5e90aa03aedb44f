#include "core/base/types.h"

#include <gtest/gtest.h>

namespace deform {
namespace {

TEST(Affine, ComposeAppliesTheSecondFirst) {
  const Affine turn{0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0};
  const Affine shift{1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0};
  EXPECT_EQ(transformed(compose(turn, shift), Vec3{1, 0, 0}), (Vec3{0, 6, 0}));
  EXPECT_EQ(transformed(compose(shift, turn), Vec3{1, 0, 0}), (Vec3{5, 1, 0}));
}

TEST(Box, EmptyHasNoDiagonal) {
  EXPECT_EQ(Box{}.diagonal(), 0);
  EXPECT_EQ(bounding_box({{0, 0, 0}, {3, 4, 0}}).diagonal(), 5);
}

}  // namespace
}  // namespace deform
