// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/measures/smooth_least.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace deform::measures::smooth_least_test {
namespace {

TEST(SmoothLeast, IsTheFormulaInLongDouble) {
  std::mt19937_64 random(4);
  for (const std::size_t count : {1U, 2U, 3U, 100U, 20000U}) {
    for (const double unit : {1e-6, 1.0, 1e5}) {
      std::uniform_real_distribution<double> uniform(-unit, 2 * unit);
      std::vector<double> samples(count);
      for (double& sample : samples) sample = uniform(random);
      const double tolerance = 0.3 * unit;
      const SmoothLeast found = smooth_least(samples, tolerance);
      const long double rho = std::log(static_cast<long double>(std::max<std::size_t>(count, 2))) / tolerance;
      long double sum = 0;
      double least = HUGE_VAL;
      for (const double sample : samples) {
        sum += std::exp(-rho * sample);
        least = std::min(least, sample);
      }
      EXPECT_NEAR(found.value, static_cast<double>(-std::log(sum) / rho), 1e-13 * unit);
      EXPECT_EQ(samples[found.least], least);
      EXPECT_LE(found.value, least);
      EXPECT_GE(found.value, least - tolerance * (1 + 1e-12));
      double weights = 0;
      for (std::size_t i = 0; i < count; ++i) {
        EXPECT_NEAR(found.weights[i], static_cast<double>(std::exp(-rho * samples[i]) / sum), 1e-12);
        weights += found.weights[i];
      }
      EXPECT_NEAR(weights, 1, 1e-12);
    }
  }
}

TEST(SmoothLeast, EqualSamplesAreTheFarthestFromIt) {
  for (const std::size_t count : {2U, 1000U, 100000U}) {
    EXPECT_NEAR(smooth_least(std::vector<double>(count, 7), 0.25).value, 6.75, 1e-12);
  }
  EXPECT_EQ(smooth_least(std::vector<double>{3}, 0.5).value, 3);
}

TEST(SmoothLeast, LeavesInfiniteSamplesOut) {
  const double infinity = std::numeric_limits<double>::infinity();
  const SmoothLeast found = smooth_least(std::vector<double>{infinity, 2, infinity, infinity}, 0.1);
  EXPECT_EQ(found.value, 2);
  EXPECT_EQ(found.least, 1U);
  EXPECT_EQ(found.weights, (std::vector<double>{0, 1, 0, 0}));
}

}  // namespace
}  // namespace deform::measures::smooth_least_test
