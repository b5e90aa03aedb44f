// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/io/text/fitted_decimal.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace deform::io::fitted_decimal_test {
namespace {

std::string nastran(double value, std::size_t width) { return fitted_decimal(value, width, DecimalStyle::nastran).value_or("-"); }
std::string abaqus(double value, std::size_t width) { return fitted_decimal(value, width, DecimalStyle::abaqus).value_or("-"); }

TEST(FittedDecimal, ExactWhereItFits) {
  EXPECT_EQ(nastran(0, 8), "0.");
  EXPECT_EQ(nastran(-0.0, 8), "-0.");
  EXPECT_EQ(nastran(3, 8), "3.");
  EXPECT_EQ(nastran(-0.25, 8), "-.25");
  EXPECT_EQ(nastran(1234567, 8), "1234567.");
  EXPECT_EQ(nastran(1e10, 8), "1.+10");
  EXPECT_EQ(nastran(1.5e-7, 8), "1.5-7");
  EXPECT_EQ(nastran(0.1, 16), ".1");
  EXPECT_EQ(abaqus(3, 20), "3");
  EXPECT_EQ(abaqus(-0.25, 20), "-0.25");
  EXPECT_EQ(abaqus(1e-300, 20), "1e-300");
  EXPECT_EQ(abaqus(0.1 + 0.2, 20), "0.30000000000000004");
}

TEST(FittedDecimal, NearestWhereItDoesNot) {
  EXPECT_EQ(nastran(1.0 / 3, 8), ".3333333");
  EXPECT_EQ(nastran(-2.0 / 3, 8), "-.666667");
  EXPECT_EQ(nastran(-0.0123456789, 8), "-.012346");
  EXPECT_EQ(nastran(-0.00123456789, 8), "-.001235") << "as near as -1.235-3, and the usual form";
  EXPECT_EQ(nastran(-0.000123456789, 8), "-1.235-4");
  EXPECT_EQ(nastran(123456.789, 8), "123456.8");
  EXPECT_EQ(nastran(9999999.6, 8), "1.+7") << "rounding adds a digit";
  EXPECT_EQ(nastran(-9999999.4, 8), "-1.+7");
  EXPECT_EQ(nastran(-123456789.0, 8), "-1.235+8");
  EXPECT_EQ(nastran(std::acos(-1), 16), "3.14159265358979");
  EXPECT_EQ(nastran(-1e-5 / 3, 16), "-3.33333333333-6");
  EXPECT_EQ(abaqus(-1.2345678901234567e-05, 20), "-1.23456789012346e-5");
}

TEST(FittedDecimal, NothingWhenAllOverflow) {
  const double largest = std::numeric_limits<double>::max();
  EXPECT_EQ(nastran(largest, 8), "-");
  EXPECT_EQ(nastran(1.1e308, 8), "1.1+308");
  EXPECT_EQ(nastran(std::numeric_limits<double>::denorm_min(), 8), "5.-324");
}

/// No number that fits is nearer: neighbours of the last digit on both sides are farther.
TEST(FittedDecimal, RandomValuesComeBackWithinHalfAUnitOfTheLastDigit) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> mantissa(-1, 1), exponent(-12, 12);
  for (int i = 0; i < 20000; ++i) {
    const double value = mantissa(random) * std::pow(10, exponent(random));
    for (const std::size_t width : {8, 16}) {
      const std::string text = nastran(value, width);
      ASSERT_LE(text.size(), width);
      ASSERT_NE(text.find('.'), std::string::npos) << text;
      const double back = *parse_decimal(text, DecimalStyle::nastran);
      // A sign, a point and an exponent of three of the columns are not digits.
      const double unit = std::pow(10, std::floor(std::log10(std::abs(value))) - static_cast<double>(width - 6));
      ASSERT_LE(std::abs(back - value), 0.5000001 * unit) << text << " for " << value;
    }
    ASSERT_LE(abaqus(value, 20).size(), 20u);
    ASSERT_NEAR(*parse_decimal(abaqus(value, 20), DecimalStyle::abaqus), value, 1e-13 * std::abs(value));
  }
}

TEST(ParseDecimal, FormsOfBothFormats) {
  const auto parse = [](std::string_view token) { return parse_decimal(token, DecimalStyle::nastran); };
  EXPECT_EQ(parse("1.5-3"), 1.5e-3);
  EXPECT_EQ(parse("-1.+5"), -1e5);
  EXPECT_EQ(parse("+.5"), 0.5);
  EXPECT_EQ(parse("7"), 7.0);
  EXPECT_EQ(parse("1.d-3"), 1e-3);
  EXPECT_EQ(parse("1.E+3"), 1e3);
  EXPECT_EQ(parse("1.-400"), 0.0);
  for (const char* wrong :
       {"", "+", "-", ".", "1.5-", "1-2-3", "--1", "+-1", "nan", "inf", "-inf", "1.+400", "1,5", "x", "1.5e", "0x10", "1 2"}) {
    EXPECT_EQ(parse(wrong), std::nullopt) << wrong;
  }
  EXPECT_EQ(parse_decimal("1.5-3", DecimalStyle::abaqus), std::nullopt);
  EXPECT_EQ(parse_decimal("1.5D-3", DecimalStyle::abaqus), 1.5e-3);
  EXPECT_EQ(parse_decimal(std::string(65, '1'), DecimalStyle::abaqus), std::nullopt);
}

}  // namespace
}  // namespace deform::io::fitted_decimal_test
