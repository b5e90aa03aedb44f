// SPDX-License-Identifier: GPL-3.0-or-later
// Systems and checks that the tests of the energy methods share.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <span>
#include <vector>

#include "core/deformers/system.h"
#include "tests/core/deformers/shapes.h"

namespace deform::test {

inline Mesh flat_sheet(std::size_t columns, std::size_t rows) {
  Mesh mesh = bumpy_sheet(columns, rows);
  for (Vec3& x : mesh.points) x[2] = 0;
  return mesh;
}

/// The sheet's setup with a second handle and variables of every kind.
inline Setup setup_with_variables() {
  deform::Setup setup = sheet_setup();
  setup.handles.push_back({"middle", box({0.95, 0.4, -1}, {1.05, 0.6, 1})});
  setup.variables.push_back({"up", "end", DesignVariable::Translate{{0.1, 0, 1}}});
  setup.variables.push_back({"turn", "end", DesignVariable::Rotate{{0, 1, 0.2}, {1.8, 0.5, 0}}});
  setup.variables.push_back({"grow", "middle", DesignVariable::Scale{{1, 0.5, 0}, {0, 1, 0}}});
  setup.variables.push_back({"roll", "middle", DesignVariable::Rotate{{1, 0, 0}, {1, 0.5, 0}}});
  setup.variables.back().also.push_back({"end", DesignVariable::Rotate{{0, 0, 1}, {1.8, 0, 0}, AngleUnit::degrees}});
  return setup;
}

/// How differences of designs become derivatives.
struct Differences {
  double h = 1e-5;            ///< what is left of the third derivative grows with its square, or with extrapolation that of the
  bool extrapolated = false;  ///< fifth with its fourth power; noise of the designs with 1 / h. Extrapolated from h and 2 h
};

/// Products with the Jacobian and its transpose agree to `dot` of the sizes, and with central differences to `difference`.
inline void check_jacobians(const System& system, double dot, double difference, const Differences& rule = {}) {
  const std::vector<double> at{0.1, 0.8, 0.2, -0.6}, direction{0.3, -0.7, 0.5, 0.9};
  const Points product = system.jacobian_vector(at, direction, {});
  const auto quotient = [&](double h) {
    Design plus{at, {}}, minus{at, {}};
    for (std::size_t k = 0; k < at.size(); ++k) {
      plus.variables[k] += h * direction[k];
      minus.variables[k] -= h * direction[k];
    }
    const Points above = system.evaluate(plus), below = system.evaluate(minus);
    Points result(above.size());
    for (std::size_t i = 0; i < result.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) result[i][k] = (above[i][k] - below[i][k]) / (2 * h);
    }
    return result;
  };
  const Points near = quotient(rule.h), wide = rule.extrapolated ? quotient(2 * rule.h) : near;
  std::mt19937_64 random(14);
  std::normal_distribution<double> normal;
  Points cotangent(product.size());
  double left = 0, left_size = 0, cotangent_size = 0, worst = 0;
  for (std::size_t i = 0; i < cotangent.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      worst = std::max(worst, std::abs(near[i][k] + (near[i][k] - wide[i][k]) / 3 - product[i][k]));
      cotangent[i][k] = normal(random);
      left += cotangent[i][k] * product[i][k];
      left_size += product[i][k] * product[i][k];
      cotangent_size += cotangent[i][k] * cotangent[i][k];
    }
  }
  EXPECT_LT(worst, difference);
  const std::vector<double> gradient = system.vector_jacobian(at, cotangent, {});
  double right = 0;
  for (std::size_t k = 0; k < at.size(); ++k) right += gradient[k] * direction[k];
  EXPECT_NEAR(left, right, dot * std::sqrt(left_size * cotangent_size));
}

/// Designs together are the designs one by one, bit for bit, on both paths.
inline void check_population(const System& system, std::size_t count) {
  std::mt19937_64 random(15);
  std::uniform_real_distribution<double> uniform(-0.3, 0.3);
  std::vector<Design> designs(count);
  for (Design& design : designs) design.variables = {uniform(random), uniform(random), uniform(random), uniform(random)};
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const auto together = system.evaluate(designs, path);
    for (std::size_t i = 0; i < designs.size(); ++i) {
      EXPECT_TRUE(system.evaluate({&designs[i], 1}, path)[0] == together[i]) << i;
    }
  }
}

}  // namespace deform::test
