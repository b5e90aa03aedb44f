// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/error.h"

#include <gtest/gtest.h>

namespace deform::error_test {
namespace {

TEST(NearestNames, SuggestsTypos) { EXPECT_EQ(nearest_names("rof", {"nose", "roof", "underbody"}), "\"roof\""); }

TEST(NearestNames, SuggestsContainedNames) {
  EXPECT_EQ(nearest_names("slant", {"rear_slant_left", "nose"}), "\"rear_slant_left\"");
}

TEST(NearestNames, SilentWhenNothingIsNear) { EXPECT_EQ(nearest_names("wheel", {"nose", "underbody"}), ""); }

TEST(NearestNames, AreNearUpToTwoLettersOrHalfTheName) {
  EXPECT_EQ(nearest_names("abcd", {"abxy", "axyz"}), "\"abxy\"") << "replaced";
  EXPECT_EQ(nearest_names("abcd", {"axbycd", "axbyczd"}), "\"axbycd\"") << "inserted";
  EXPECT_EQ(nearest_names("azbcyd", {"abcd", "xaxbcxdx"}), "\"abcd\"") << "left out";
  EXPECT_EQ(nearest_names("a", {"xy", "xyz"}), "\"xy\"") << "two letters for short names, too";
  EXPECT_EQ(nearest_names("abcdefgh", {"abcdwxyz", "abcvwxyz"}), "\"abcdwxyz\"") << "half of a long name";
  EXPECT_EQ(nearest_names("", {"ab", "abc"}), "\"ab\"");
}

TEST(NearestNames, BeginWithTheNearest) {
  EXPECT_EQ(nearest_names("wheel", {"wxyel", "whxel", "rear_wheel"}), "\"whxel\", \"wxyel\", \"rear_wheel\"");
}

TEST(NearestNames, ArePassedOverIfTheyAreVeryLong) {
  const std::string longest(256, 'a');
  EXPECT_EQ(nearest_names(longest, {longest, longest + "a"}), "\"" + longest + "\"");
  EXPECT_EQ(nearest_names(longest + "a", {longest}), "");
}

TEST(NearestNames, AtMostThree) { EXPECT_EQ(nearest_names("a1", {"a2", "a3", "a4", "a5"}), "\"a2\", \"a3\", \"a4\""); }

TEST(Error, KeepsCodeAndMessage) {
  const Error error(ErrorCode::out_of_budget, "needed 3, available 2");
  EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
  EXPECT_STREQ(error.what(), "needed 3, available 2");
  EXPECT_STREQ(to_string(error.code()), "out_of_budget");
}

}  // namespace
}  // namespace deform::error_test
