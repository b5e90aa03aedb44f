// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/point_owners.h"

#include <gtest/gtest.h>

namespace deform::point_owners_test {
namespace {

using Ids = std::vector<PointId>;
constexpr auto nobody = PointOwners::nobody;

TEST(PointOwners, TheFirstKeepsWhatASecondWants) {
  PointOwners owners(5);
  EXPECT_EQ(owners.claim(Ids{1, 2}, 0).points, 0U);
  EXPECT_EQ(owners.claim(Ids{2, 1}, 0).points, 0U) << "its own";
  const auto overlap = owners.claim(Ids{0, 1, 2, 3}, 7);
  EXPECT_EQ(overlap.points, 2U);
  EXPECT_EQ(overlap.first, 1U);
  EXPECT_EQ(overlap.other, 0U);
  EXPECT_EQ(owners.owners(), (std::vector<std::uint32_t>{7, 0, 0, 7, nobody}));
  const auto of_several = owners.claim(Ids{4, 3, 2, 1, 0}, 8);
  EXPECT_EQ(of_several.other, 7U);
  EXPECT_EQ(of_several.points, 2U) << "not those of the others";
  EXPECT_EQ(overlap.text("handle \"a\""),
            "overlaps handle \"a\": 2 common points, the first is point 1; subtract one region from the other with `difference`");
}

}  // namespace
}  // namespace deform::point_owners_test
