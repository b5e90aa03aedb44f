// SPDX-License-Identifier: GPL-3.0-or-later
// Expressions against trees whose values are known because they were computed before the text was written; errors; noise.
#include "client/setup/expression.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>

#include "tests/support/expect_error.h"

namespace deform::client::expression_test {
namespace {

using test::expect_error;

std::optional<double> box_lengths(std::string_view name) {
  if (name == "L") return 3.0;
  if (name == "Lx") return 2.0;
  return std::nullopt;
}

double value(const std::string& text) { return evaluate_expression(text, box_lengths); }

TEST(Expression, KnowsPrecedence) {
  EXPECT_EQ(value("2 + 3*4"), 14);
  EXPECT_EQ(value("(2 + 3)*4"), 20);
  EXPECT_EQ(value("8/4/2"), 1);
  EXPECT_EQ(value("8-4-2"), 2);
  EXPECT_EQ(value("2^3^2"), 512);
  EXPECT_EQ(value("-2^2"), -4);
  EXPECT_EQ(value("2^-1"), 0.5);
  EXPECT_EQ(value("--3 - -1"), 4);
  EXPECT_EQ(value("0.05*L"), 0.05 * 3);
  EXPECT_EQ(value(" -Lx/2 "), -1);
  EXPECT_EQ(value("1e-3*L"), 3e-3);
  EXPECT_EQ(value(".5"), 0.5);
  EXPECT_EQ(value("pi"), 4 * std::atan(1.0));
  EXPECT_EQ(value("sqrt(2)*sqrt (2)"), std::sqrt(2.0) * std::sqrt(2.0));
  EXPECT_EQ(value("abs(-3) + cos(0) + sin(0) + tan(0)"), 4);
}

/// A random expression: fully parenthesized text, text with only the parentheses that precedence asks for, and its value.
struct Tree {
  std::string full, sparse;
  double value = 0;
  int precedence = 0;  // 0 sum, 1 product, 2 operand
};

Tree random_tree(std::mt19937& random, int depth) {
  const auto pick = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  if (depth == 0 || pick(5) == 0) {
    if (pick(3) == 0) return {"L", "L", 3.0, 2};
    const int number = pick(9) + 1;
    return {std::to_string(number), std::to_string(number), double(number), 2};
  }
  const Tree a = random_tree(random, depth - 1), b = random_tree(random, depth - 1);
  const int kind = pick(4);
  const char symbol = "+-*/"[kind];
  const int own = kind < 2 ? 0 : 1;
  Tree tree{"(" + a.full + symbol + b.full + ")", "", 0, own};
  tree.sparse = (a.precedence < own ? "(" + a.sparse + ")" : a.sparse) + " " + symbol + " " +
                (b.precedence <= own ? "(" + b.sparse + ")" : b.sparse);
  tree.value = kind == 0 ? a.value + b.value : kind == 1 ? a.value - b.value : kind == 2 ? a.value * b.value : a.value / b.value;
  return tree;
}

TEST(Expression, OfRandomTreesHasTheirValues) {
  std::mt19937 random(12);
  int finite = 0;
  for (int k = 0; k < 3000; ++k) {
    const Tree tree = random_tree(random, 4);
    if (!std::isfinite(tree.value)) continue;
    try {
      EXPECT_EQ(value(tree.full), tree.value) << tree.full;
      EXPECT_EQ(value(tree.sparse), tree.value) << tree.sparse;
      ++finite;
    } catch (const Error& error) {  // something on the way was not finite, as 1/(1/0)
      EXPECT_THAT(error.what(), testing::HasSubstr("not finite"));
    }
  }
  EXPECT_GT(finite, 2500);
}

TEST(Expression, SaysWhatIsWrongWhere) {
  const auto refused = [](const std::string& text, const std::vector<const char*>& parts) {
    SCOPED_TRACE(text);
    expect_error(ErrorCode::invalid_argument, parts, [&] { value(text); });
  };
  refused("", {"column 1", "expected a number"});
  refused("2 +", {"column 4", "expected a number"});
  refused("2 3", {"column 3", "expected an operator"});
  refused("(2", {"column 3", "expected )"});
  refused("2)", {"column 2", "expected an operator"});
  refused("3*Ly", {"column 3", "there is no name \"Ly\""});
  refused("sqrt 2", {"column 6", "expected ( behind sqrt"});
  refused("1/0", {"not finite"});
  refused("sqrt(-1)", {"column 1", "not finite"});
  refused("10^400", {"not finite"});
  refused("1e999", {"column 1", "out of range"});
  refused("inf", {"there is no name \"inf\""});
  refused("nan", {"there is no name \"nan\""});
  refused("2**3", {"column 3"});
  refused(std::string(60, '('), {"nested deeper than 50"});
  refused(std::string(60, '-') + "1", {"nested deeper than 50"});
  refused("1" + std::string(1000, ' '), {"at most 1000 characters"});
  expect_error(ErrorCode::invalid_argument, {"no name \"L\""}, [] { evaluate_expression("L"); });
}

TEST(Expression, OfNoiseIsANumberOrAnError) {
  std::mt19937 random(7);
  const std::string letters = "0123456789.eE+-*/^() LpisqrtcosLxy_#\t\xff";
  int numbers = 0;
  for (int k = 0; k < 200'000; ++k) {
    std::string text;
    for (std::size_t i = random() % 12; i > 0; --i) text += letters[random() % letters.size()];
    try {
      ASSERT_TRUE(std::isfinite(value(text))) << text;
      ++numbers;
    } catch (const Error& error) {
      ASSERT_EQ(error.code(), ErrorCode::invalid_argument);
    }
  }
  EXPECT_GT(numbers, 1000);
}

}  // namespace
}  // namespace deform::client::expression_test
