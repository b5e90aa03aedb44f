// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "core/constraints/projection.h"
#include "tests/support/linear_algebra.h"

// What holds for every projection, checked on given points.

namespace deform::test {

struct Projected {
  Points points;
  double energy = 0;
  ShapeParameters shape;
};

inline Projected projected(const Projection& projection, const Points& x, ShapeParameters start = {}) {
  Projected result{Points(x.size()), 0, std::move(start)};
  result.energy = projection.project(x, result.points, result.shape);
  return result;
}

inline double squared(const Points& a, const Points& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) sum += (a[i][k] - b[i][k]) * (a[i][k] - b[i][k]);
  }
  return sum;
}

inline double largest(const Points& a, const Points& b) {
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) most = std::max(most, std::abs(a[i][k] - b[i][k]));
  }
  return most;
}

inline double dot(const Points& a, const Points& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i][0] * b[i][0] + a[i][1] * b[i][1] + a[i][2] * b[i][2];
  return sum;
}

/// x + t d
inline Points along(const Points& x, double t, const Points& d) {
  Points moved = x;
  for (std::size_t i = 0; i < x.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) moved[i][k] += t * d[i][k];
  }
  return moved;
}

inline Points normal_noise(std::size_t count, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Points noise(count);
  for (Vec3& p : noise) {
    for (double& c : p) {  // a sum of uniforms: the same numbers with every standard library
      c = -6;
      for (int k = 0; k < 12; ++k) c += static_cast<double>(random() >> 11) * 0x1p-53;
    }
  }
  return noise;
}

inline Points noisy(const Points& x, double size, std::uint64_t seed) { return along(x, size, normal_noise(x.size(), seed)); }

/// A rotation and translation that nothing is aligned with.
inline Eigen::Isometry3d tilted(double angle = 0.7) {
  Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
  motion.translate(Eigen::Vector3d(0.3, -0.2, 0.4));
  motion.rotate(Eigen::AngleAxisd(angle, Eigen::Vector3d(1, 2, -0.5).normalized()));
  return motion;
}

inline Points moved(const Points& x, const Eigen::Isometry3d& motion) {
  Points result;
  for (const Vec3& p : x) {
    const Eigen::Vector3d y = motion * Eigen::Vector3d(p[0], p[1], p[2]);
    result.push_back({y[0], y[1], y[2]});
  }
  return result;
}

/// Points that satisfy the constraint stay where they are.
inline void expect_unmoved(const Projection& projection, const Points& x, double tolerance = 1e-12) {
  const Projected p = projected(projection, x);
  EXPECT_LE(largest(p.points, x), tolerance);
  EXPECT_LE(std::sqrt(p.energy), tolerance * std::sqrt(3.0 * static_cast<double>(x.size())));
}

/// The energy is the squared distance, projecting twice changes nothing, and no configuration found by projecting points nearby
/// is nearer. A fit that is not the least-squares fit fails here: its neighbours are nearer.
inline void expect_nearest(const Projection& projection, const Points& x, double tolerance = 1e-10) {
  const Projected p = projected(projection, x);
  EXPECT_NEAR(p.energy, squared(x, p.points), 1e-12 * (1 + p.energy));
  const Projected twice = projected(projection, p.points, p.shape);
  EXPECT_LE(largest(twice.points, p.points), tolerance);
  EXPECT_LE(largest(projected(projection, p.points).points, p.points), tolerance);
  for (int k = 0; k < 40; ++k) {
    const double size = std::pow(10.0, -4 + k % 4) * 3;
    const Points near = along(p.points, size, normal_noise(x.size(), 100 + static_cast<std::uint64_t>(k)));
    const Points competitor = projected(projection, near, p.shape).points;
    EXPECT_GE(squared(x, competitor), p.energy * (1 - 1e-10) - 1e-24) << "after moving by " << size;
  }
}

/// Central differences, symmetry, and that a projection does not stretch what stays in the set.
inline void expect_derivative(const Projection& projection, const Points& x, double tolerance = 1e-6) {
  const Projected p = projected(projection, x);
  Points images[2];
  Points directions[2];
  for (std::size_t k = 0; k < 2; ++k) {
    directions[k] = normal_noise(x.size(), 7 + k);
    images[k].resize(x.size());
    projection.derivative(x, p.shape, directions[k], images[k]);
    constexpr double step = 1e-5;
    const Points plus = projected(projection, along(x, step, directions[k]), p.shape).points;
    const Points minus = projected(projection, along(x, -step, directions[k]), p.shape).points;
    Points difference = along(plus, -1, minus);
    for (Vec3& d : difference) {
      for (double& c : d) c /= 2 * step;
    }
    EXPECT_LE(largest(difference, images[k]), tolerance);
  }
  const double forward = dot(directions[1], images[0]), backward = dot(directions[0], images[1]);
  EXPECT_NEAR(forward, backward, 1e-10 * static_cast<double>(x.size()));
}

/// The sum of squares, its first derivative, and that the least sum of squares over dq is the energy after a small step: `error`
/// is what the curvature of the shape may add, relative.
inline void expect_linearization(const Projection& projection, const Points& x, double step, double error) {
  const Projected p = projected(projection, x);
  const Linearization at = projection.linearize(x, p.shape);
  const std::size_t rows = at.rows_per_point;
  ASSERT_EQ(at.normals.size(), rows * x.size());
  ASSERT_EQ(at.residual.size(), static_cast<Eigen::Index>(at.normals.size()));
  ASSERT_EQ(at.parameters.rows(), at.residual.size());
  ASSERT_TRUE(at.partners.empty() || at.partners.size() == at.normals.size());
  ASSERT_EQ(at.partner_normals.size(), at.partners.size());
  EXPECT_NEAR(at.residual.squaredNorm(), p.energy, 1e-12 * (1e-12 + p.energy));
  Points away(x.size(), Vec3{});
  const Points d = normal_noise(x.size(), 17);
  Eigen::VectorXd change(at.residual.size());
  for (std::size_t row = 0; row < at.normals.size(); ++row) {
    const auto r = static_cast<Eigen::Index>(row);
    change[r] = 0;
    const auto add = [&](std::size_t point, const Vec3& n) {
      for (std::size_t k = 0; k < 3; ++k) {
        away[point][k] += at.residual[r] * n[k];
        change[r] += n[k] * d[point][k];
      }
    };
    const Vec3& n = at.normals[row];
    add(row / rows, n);
    if (at.partners.empty()) {
      const double length = std::hypot(n[0], n[1], n[2]);
      EXPECT_TRUE(std::abs(length - 1) < 1e-12 || length == 0) << length;
    } else {
      add(at.partners[row], at.partner_normals[row]);
    }
  }
  EXPECT_LE(largest(along(x, -1, away), p.points), 1e-12);
  // The parameters do not matter to first order.
  if (at.parameters.cols() > 0) {
    const Eigen::VectorXd slope = at.parameters.transpose() * at.residual;
    EXPECT_LE(slope.norm(), (1e-9 * std::sqrt(p.energy) + 1e-13) * at.parameters.norm());
  }
  Eigen::VectorXd predicted = at.residual + step * change;
  if (at.parameters.cols() > 0) {
    predicted += at.parameters * test::least_norm_solution(at.parameters, -predicted);
  }
  const double after = projected(projection, along(x, step, d), p.shape).energy;
  EXPECT_NEAR(predicted.squaredNorm(), after, error * after);
}

/// Rotating and moving the points rotates and moves the projection.
inline void expect_equivariant(const Projection& projection, const Points& x, double tolerance = 1e-9) {
  const Points there = projected(projection, moved(x, tilted(1.9))).points;
  EXPECT_LE(largest(there, moved(projected(projection, x).points, tilted(1.9))), tolerance);
}

/// From the shape of other points nearby, or moved ones, the same result as from none; the same bits when repeated.
inline void expect_same_from_any_start(const Projection& projection, const Points& x, double tolerance = 1e-9) {
  const Projected cold = projected(projection, x);
  const ShapeParameters near = projected(projection, noisy(x, 0.01, 31)).shape;
  EXPECT_LE(largest(projected(projection, x, near).points, cold.points), tolerance);
  const ShapeParameters far = projected(projection, along(noisy(x, 0.003, 32), 1, Points(x.size(), Vec3{0.4, -0.3, 0.2}))).shape;
  EXPECT_LE(largest(projected(projection, x, far).points, cold.points), tolerance);
  const Projected again = projected(projection, x);
  EXPECT_EQ(again.points, cold.points);
  EXPECT_EQ(again.shape, cold.shape);
  EXPECT_EQ(again.energy, cold.energy);
}

/// Everything above for points that nearly satisfy the constraint: `exact` do, `noise` is added.
inline void expect_projection(const Projection& projection, const Points& exact, double noise) {
  ASSERT_EQ(projection.point_count(), exact.size());
  expect_unmoved(projection, exact);
  expect_linearization(projection, exact, 1e-5, 1e-2);
  const Points x = noisy(exact, noise, 3);
  expect_nearest(projection, x);
  expect_derivative(projection, x);
  expect_linearization(projection, x, 1e-6, 1e-6);
  if (projection.moves_with_its_points()) expect_equivariant(projection, x);
  expect_same_from_any_start(projection, x);
}

/// Whatever is handed in, something finite comes back, and it is not farther than the points are from each other.
inline void expect_survives(const Projection& projection, const Points& x) {
  const Projected p = projected(projection, x);
  EXPECT_TRUE(std::isfinite(p.energy));
  EXPECT_TRUE(std::isfinite(dot(p.points, p.points)));
  Points image(x.size());
  projection.derivative(x, p.shape, normal_noise(x.size(), 5), image);
  EXPECT_TRUE(std::isfinite(dot(image, image)));
  EXPECT_TRUE(projection.linearize(x, p.shape).parameters.allFinite());
}

}  // namespace deform::test
