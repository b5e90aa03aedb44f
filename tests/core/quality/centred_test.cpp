// SPDX-License-Identifier: GPL-3.0-or-later
// The arithmetic of bounds, against values at many places: nothing lies outside of them, and those of a length are attained.
#include "core/quality/centred.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

namespace deform::quality {
namespace {

constexpr double rounding = 1e-14;  // of numbers up to about 10

/// A linear function of u in [-1, 1].
struct Line {
  double value, slope;
  double at(double u) const { return value + u * slope; }
  Centred centred() const { return Centred::linear(value, slope, 0, 1); }
};

/// The bounds of f and of its derivative, by differences, hold everywhere in [-1, 1].
template <typename F>
void expect_bounds(const Centred& bounds, const F& f) {
  EXPECT_NEAR(bounds.value, f(0.0), rounding);
  constexpr int steps = 200;
  for (int i = 0; i <= steps; ++i) {
    const double u = -1 + 2.0 * i / steps, size = 1e-12 + rounding * bounds.range.magnitude();
    EXPECT_GE(f(u), bounds.range.low - size);
    EXPECT_LE(f(u), bounds.range.high + size);
    if (i == steps) break;
    const double slope = (f(u + 2.0 / steps) - f(u)) * steps / 2;  // that of some place between, by the mean value theorem
    EXPECT_GE(slope, bounds.derivative.low - 1e-10);
    EXPECT_LE(slope, bounds.derivative.high + 1e-10);
  }
}

TEST(Centred, BoundsHoldForSumsProductsInversesAndLengths) {
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> uniform(-2, 2);
  for (int i = 0; i < 300; ++i) {
    const Line a{uniform(random), uniform(random)}, b{uniform(random), uniform(random)}, c{uniform(random), uniform(random)};
    const Centred x = a.centred(), y = b.centred(), z = c.centred();
    expect_bounds(x + y, [&](double u) { return a.at(u) + b.at(u); });
    expect_bounds(x - y, [&](double u) { return a.at(u) - b.at(u); });
    expect_bounds(x * y, [&](double u) { return a.at(u) * b.at(u); });
    expect_bounds(x * y * z, [&](double u) { return a.at(u) * b.at(u) * c.at(u); });
    expect_bounds(-1.5 * x, [&](double u) { return -1.5 * a.at(u); });
    expect_bounds(length(Triple<Centred>{x, y, z}), [&](double u) { return std::hypot(a.at(u), b.at(u), c.at(u)); });
    const Line away{2.5 + std::abs(uniform(random)), uniform(random)};
    expect_bounds(inverse(away.centred()), [&](double u) { return 1 / away.at(u); });
  }
}

// A vector anywhere in a box: the nearest and the farthest place of the box from the origin, by looking at all of a grid that has
// its corners, edges and faces, and the origin where it is inside.
TEST(Centred, LengthsHaveTheBoundsOfTheirBox) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-2, 2);
  for (int i = 0; i < 200; ++i) {
    Triple<Centred> vector;
    std::array<std::array<double, 3>, 3> places{};
    for (std::size_t k = 0; k < 3; ++k) {
      const double a = uniform(random), b = uniform(random), low = std::min(a, b), high = std::max(a, b);
      vector[k] = Centred::linear((low + high) / 2, (high - low) / 2, 0, 1);
      places[k] = {low, high, low < 0 && high > 0 ? 0 : low};
    }
    double nearest = std::numeric_limits<double>::infinity(), farthest = 0;
    for (const double x : places[0]) {
      for (const double y : places[1]) {
        for (const double z : places[2]) {
          nearest = std::min(nearest, std::hypot(x, y, z));
          farthest = std::max(farthest, std::hypot(x, y, z));
        }
      }
    }
    const Centred bounds = length(vector);
    const double reach = bounds.derivative.magnitude();
    EXPECT_NEAR(bounds.range.low, std::max(nearest, bounds.value - reach), rounding);
    EXPECT_NEAR(bounds.range.high, std::min(farthest, bounds.value + reach), rounding);
  }
}

TEST(Centred, WithoutABoundThereIsNone) {
  const Centred unknown(1, {-unbounded, unbounded}, {-unbounded, unbounded});
  EXPECT_EQ((unknown * Centred(0)).range.low, -unbounded);
  EXPECT_EQ((unknown * Centred(0)).range.high, unbounded);
  const Centred through_zero = inverse(Centred::linear(0.5, 1, 0, 1));
  EXPECT_EQ(through_zero.value, 2);
  EXPECT_EQ(through_zero.range.low, -unbounded);
  EXPECT_EQ(through_zero.derivative.high, unbounded);
  EXPECT_EQ(inverse(4.0), 0.25);
}

}  // namespace
}  // namespace deform::quality
