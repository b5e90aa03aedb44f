// SPDX-License-Identifier: GPL-3.0-or-later
// The arithmetic of bounds, against values at many places: nothing lies outside of them, and they come close.
#include "core/quality/taylor_model.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace deform::quality::taylor_model_test {
namespace {

constexpr double rounding = 1e-12;  // of numbers up to about 100

double at(const TaylorModel& model, double u) { return model.c[0] + u * (model.c[1] + u * (model.c[2] + u * model.c[3])); }

/// The polynomial is within its rest of f, and the bounds hold, everywhere in [-1, 1]. Returns how far the bounds are apart, over
/// how far the least and the largest value are.
template <typename F>
double expect_bounds(const TaylorModel& model, const F& f) {
  constexpr int steps = 400;
  double least = std::numeric_limits<double>::infinity(), largest = -least;
  for (int i = 0; i <= steps; ++i) {
    const double u = -1 + 2.0 * i / steps, value = f(u), size = rounding * (1 + model.magnitude());
    EXPECT_LE(std::abs(value - at(model, u)), model.rest + size) << u;
    EXPECT_GE(value, lower_bound(model) - size) << u;
    EXPECT_LE(value, upper_bound(model) + size) << u;
    EXPECT_LE(std::abs(value), model.magnitude() + size) << u;
    least = std::min(least, value);
    largest = std::max(largest, value);
  }
  return (upper_bound(model) - lower_bound(model)) / (largest - least);
}

struct Numbers {
  std::mt19937_64 random{4};
  double in(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); }
  /// A quadratic polynomial.
  TaylorModel curve() { return {in(-2, 2), in(-2, 2), in(-1, 1)}; }
};

TEST(TaylorModel, BoundsHoldForSumsAndProducts) {
  Numbers numbers;
  for (int i = 0; i < 500; ++i) {
    const TaylorModel x = numbers.curve(), y = numbers.curve(), z = numbers.curve();
    EXPECT_LE(expect_bounds(x, [&](double u) { return at(x, u); }), 1 + 1e-4) << "those of a quadratic polynomial are attained";
    expect_bounds(x + y, [&](double u) { return at(x, u) + at(y, u); });
    expect_bounds(x - y, [&](double u) { return at(x, u) - at(y, u); });
    expect_bounds(-1.5 * x, [&](double u) { return -1.5 * at(x, u); });
    expect_bounds(x * y, [&](double u) { return at(x, u) * at(y, u); });
    const TaylorModel xyz = x * y * z;  // of degree 6
    expect_bounds(xyz, [&](double u) { return at(x, u) * at(y, u) * at(z, u); });
    expect_bounds(xyz * xyz, [&](double u) { return std::pow(at(x, u) * at(y, u) * at(z, u), 2); });
  }
}

TaylorModel length(const Triple<TaylorModel>& a) { return square_root(dot(a, a)); }

/// The same polynomial and rest up to rounding.
void expect_same(const TaylorModel& a, const TaylorModel& b) {
  for (std::size_t k = 0; k < 4; ++k) EXPECT_NEAR(a.c[k], b.c[k], rounding) << k;
  EXPECT_NEAR(a.rest, b.rest, rounding);
}

TEST(TaylorModel, SpecialProductsAreThoseOfAnyFunctions) {
  Numbers numbers;
  for (int i = 0; i < 100; ++i) {
    const TaylorModel f(numbers.in(-2, 2), numbers.in(-2, 2), numbers.in(-2, 2), numbers.in(-2, 2), numbers.in(0, 1));
    const double constant = numbers.in(-2, 2), linear = numbers.in(-2, 2);
    expect_same(times_linear(f, constant, linear), f * TaylorModel(constant, linear, 0));
    const Triple<TaylorModel> vector{numbers.curve(), numbers.curve(), numbers.curve()};
    const auto powers = [&](std::size_t k) { return Vec3{vector[0].c[k], vector[1].c[k], vector[2].c[k]}; };
    expect_same(squared_length(powers(0), powers(1), powers(2)), dot(vector, vector));
  }
}

TEST(TaylorModel, BoundsHoldForInversesAndLengths) {
  Numbers numbers;
  double farthest_inverse = 0, farthest_length = 0;
  for (int i = 0; i < 500; ++i) {
    const TaylorModel away(numbers.in(2.2, 4), numbers.in(-1, 1), numbers.in(-1, 1));
    farthest_inverse = std::max(farthest_inverse, expect_bounds(inverse(away), [&](double u) { return 1 / at(away, u); }));
    const Triple<TaylorModel> vector{away, numbers.curve(), numbers.curve()};
    const auto size = [&](double u) { return std::hypot(at(vector[0], u), at(vector[1], u), at(vector[2], u)); };
    expect_bounds(length(vector), size);
    const TaylorModel nearly(numbers.in(3, 4), numbers.in(-0.3, 0.3), 0);
    const Triple<TaylorModel> short_way{nearly, TaylorModel(numbers.in(-2, 2), 0.2, 0), TaylorModel(1)};
    const double apart = expect_bounds(
        length(short_way), [&](double u) { return std::hypot(at(short_way[0], u), at(short_way[1], u), at(short_way[2], u)); });
    farthest_length = std::max(farthest_length, apart);
    // Through the origin or near it: no polynomial is near, but bounds there are.
    const Triple<TaylorModel> any{numbers.curve(), numbers.curve(), numbers.curve()};
    expect_bounds(length(any), [&](double u) { return std::hypot(at(any[0], u), at(any[1], u), at(any[2], u)); });
    double longest_place = 0;
    for (int k = 0; k <= 200; ++k) {
      const double u = -1 + k / 100.0;
      longest_place = std::max(longest_place, std::hypot(at(any[0], u), at(any[1], u), at(any[2], u)));
    }
    EXPECT_GE(longest(any), longest_place * (1 - rounding));
  }
  EXPECT_LE(farthest_inverse, 5);
  EXPECT_LE(farthest_length, 1.5);
}

// What is left out falls with the fourth power of the interval.
TEST(TaylorModel, HalvingTheIntervalLeavesASixteenth) {
  const auto left_out = [](double radius) {
    const TaylorModel x(1.5, radius, 0), y(0.5, -0.4 * radius, 0);
    return (inverse(x) * length(Triple<TaylorModel>{x, y, x * y})).rest;
  };
  EXPECT_NEAR(left_out(0.1) / left_out(0.05), 16, 1.5);
}

TEST(TaylorModel, WithoutABoundThereIsNone) {
  const TaylorModel through_zero = inverse(TaylorModel(0.5, 1, 0));
  EXPECT_FALSE(lower_bound(through_zero) > 0);
  EXPECT_FALSE(lower_bound(through_zero * TaylorModel(1)) > -1e300);
  EXPECT_FALSE(lower_bound(through_zero * TaylorModel(0)) > -1e300);
  EXPECT_FALSE(lower_bound(square_root(through_zero)) > -1e300);
  EXPECT_FALSE(lower_bound(inverse(through_zero)) > -1e300);
  EXPECT_EQ(inverse(4.0), 0.25);
}

}  // namespace
}  // namespace deform::quality::taylor_model_test
