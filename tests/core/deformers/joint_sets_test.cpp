// SPDX-License-Identifier: GPL-3.0-or-later
// Many sets on common points: more parameters of shapes than dense decompositions take.
#include "core/deformers/constrained/joint_sets.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/vectors.h"
#include "core/constraints/plane.h"

namespace deform::joint_sets_test {
namespace {

constexpr std::size_t patches = 150, own = 8;  // three parameters each

/// A folded strip of patches that are nearly plane, eight points of their own each; each but the last also has the first two
/// points of the next one, on the fold between them.
struct Chain {
  std::vector<ConstraintSet> sets;
  SetsOnPoints on;
  std::vector<Vec3> points;

  Chain() {
    double x = 0, z = 0;
    for (std::size_t t = 0; t < patches; ++t) {
      const double angle = (t % 2 == 0 ? 0.35 : -0.35) + 0.05 * std::sin(static_cast<double>(t));
      for (std::size_t i = 0; i < own; ++i) {
        const double along = 0.0125 * static_cast<double>(i / 2), across = 0.06 * static_cast<double>(i % 2);
        const double off = 1e-4 * std::sin(static_cast<double>(5 * t + 3 * i));
        points.push_back({x + along * std::cos(angle), across, z + along * std::sin(angle) + off});
      }
      x += 0.05 * std::cos(angle);
      z += 0.05 * std::sin(angle);
    }
    sets.resize(patches);
    for (std::size_t t = 0; t < patches; ++t) {
      std::vector<std::uint32_t>& places = on.places.emplace_back();
      for (std::size_t i = 0; i < own + (t + 1 < patches ? 2 : 0); ++i) places.push_back(static_cast<std::uint32_t>(own * t + i));
      sets[t].projection = plane_projection(places.size());
      for (const std::uint32_t u : places) {
        sets[t].ids.push_back(u);
        sets[t].rest.push_back(points[u]);
      }
      on.sets.push_back(&sets[t]);
    }
    on.moves.assign(points.size(), true);
    on.moves[own * 40] = false;
  }

  JointSets::State placed(const std::vector<Vec3>& from) const {
    return JointSets(on).place(from, std::vector<ShapeParameters>(patches), 1, {});
  }
};

std::vector<Vec3> wave(std::size_t count, double phase) {
  std::vector<Vec3> result(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double at = static_cast<double>(i);
    result[i] = {std::sin(at + phase), std::cos(2 * at - phase), std::sin(3 * at + 2 * phase)};
  }
  return result;
}

double sum_of_products(const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += dot(a[i], b[i]);
  return sum;
}

/// How far the points of a set are from a plane: its thinnest extent, by the smallest eigenvalue of their scatter.
double thickness(const std::vector<Vec3>& points, const std::vector<std::uint32_t>& places) {
  Vec3 mean{};
  for (const std::uint32_t u : places) mean = mean + points[u] / static_cast<double>(places.size());
  // All volumes of four points vanish.
  double most = 0;
  for (std::size_t a = 1; a + 1 < places.size(); ++a) {
    for (std::size_t b = a + 1; b < places.size(); ++b) {
      const Vec3 normal = cross(points[places[a]] - points[places[0]], points[places[b]] - points[places[0]]);
      if (norm(normal) < 1e-4) continue;
      for (const std::uint32_t u : places) most = std::max(most, std::abs(dot(points[u] - mean, normal)) / norm(normal));
    }
  }
  return most;
}

TEST(JointSets, ManySetsAreAllMetWithTheLeastMovement) {
  const Chain chain;
  const JointSets::State at = chain.placed(chain.points);
  ASSERT_TRUE(at.found);
  for (std::size_t t = 0; t < patches; ++t) EXPECT_LT(thickness(at.points, chain.on.places[t]), 1e-7) << t;
  EXPECT_EQ(at.points[own * 40], chain.points[own * 40]) << "it does not move";
  // Places on the shapes that are found from nearby are farther.
  double least = 0;
  for (std::size_t i = 0; i < at.points.size(); ++i) least += squared_distance(at.points[i], chain.points[i]);
  const std::vector<Vec3> d = wave(chain.points.size(), 0.4);
  for (const double h : {-3e-5, 3e-5}) {
    std::vector<Vec3> near = chain.points;
    for (std::size_t i = 0; i < near.size(); ++i) {
      if (chain.on.moves[i]) near[i] = near[i] + h * d[i];
    }
    const JointSets::State other = chain.placed(near);
    ASSERT_TRUE(other.found);
    double sum = 0;
    for (std::size_t i = 0; i < near.size(); ++i) sum += squared_distance(other.points[i], chain.points[i]);
    EXPECT_GE(sum, least * (1 - 1e-9));
  }
}

TEST(JointSets, DerivativesOfManySetsAreDifferences) {
  const Chain chain;
  const JointSets::State at = chain.placed(chain.points);
  ASSERT_TRUE(at.found);
  const std::vector<Vec3> d = wave(chain.points.size(), 1.1), g = wave(chain.points.size(), -0.7);
  constexpr double h = 1e-6;
  std::vector<Vec3> plus = chain.points, minus = chain.points;
  for (std::size_t i = 0; i < d.size(); ++i) {
    plus[i] = plus[i] + h * d[i];
    minus[i] = minus[i] - h * d[i];
  }
  const JointSets::State above = chain.placed(plus), below = chain.placed(minus);
  ASSERT_TRUE(above.found && below.found);
  const std::vector<Vec3> product = JointSets(chain.on).derivative(at, d, {});
  double largest = 0;
  for (std::size_t i = 0; i < d.size(); ++i) {
    largest = std::max(largest, norm(product[i] - (above.points[i] - below.points[i]) / (2 * h)));
  }
  EXPECT_LT(largest, 1e-6);
  EXPECT_NEAR(sum_of_products(product, g), sum_of_products(d, JointSets(chain.on).adjoint(at, g, {})),
              1e-9 * static_cast<double>(d.size()));
}

}  // namespace
}  // namespace deform::joint_sets_test
