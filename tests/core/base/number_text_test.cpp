// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/number_text.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <limits>

namespace deform::number_text_test {
namespace {

TEST(NumberDigits, AreTheFewestThatReadBack) {
  EXPECT_EQ(number_digits(0.1), "0.1");
  EXPECT_EQ(number_digits(0.10000000149011612), "0.10000000149011612");
  EXPECT_EQ(number_digits(-0.05), "-0.05");
  EXPECT_EQ(number_digits(0), "0");
  EXPECT_EQ(number_digits(100000), "100000");
  EXPECT_EQ(number_digits(1e-7), "1e-07");
  EXPECT_EQ(number_digits(1e300), "1e+300");
  EXPECT_EQ(number_digits(-std::numeric_limits<double>::infinity()), "-inf");
  EXPECT_EQ(number_digits(std::numeric_limits<double>::quiet_NaN()), "nan");
  for (const double value : {1.0 / 3, 2e9 / 3, 1e-4 / 3, 1e8 / 3, 5e-324, 1.7976931348623157e308, -9e15 / 7}) {
    EXPECT_EQ(std::strtod(number_digits(value).c_str(), nullptr), value);
  }
}

TEST(ThreeDigits, AreSignificantOnes) {
  EXPECT_EQ(three_digits(0.012345), "0.0123");
  EXPECT_EQ(three_digits(1234), "1.23e+03");
  EXPECT_EQ(three_digits(0), "0");
}

TEST(Mebibytes, AreKibibytesBelowOne) {
  constexpr std::size_t kibi = 1024, mebi = kibi * kibi;
  EXPECT_EQ(mebibytes(0), "0.0 MiB");
  EXPECT_EQ(mebibytes(1), "0.0 KiB");
  EXPECT_EQ(mebibytes(100), "0.1 KiB");
  EXPECT_EQ(mebibytes(1023 * kibi), "1023.0 KiB");
  EXPECT_EQ(mebibytes(mebi), "1.0 MiB");
  EXPECT_EQ(mebibytes(3 * mebi / 2), "1.5 MiB");
  EXPECT_EQ(mebibytes(1536 * mebi), "1536.0 MiB");
}

}  // namespace
}  // namespace deform::number_text_test
