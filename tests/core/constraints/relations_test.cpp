// SPDX-License-Identifier: GPL-3.0-or-later
// Relations: parallel and orthogonal planes, mirror images, distances, extents.
#include <algorithm>
#include <cmath>

#include "core/constraints/distance.h"
#include "core/constraints/extent.h"
#include "core/constraints/pairing.h"
#include "core/constraints/related_planes.h"
#include "core/constraints/symmetric.h"
#include "tests/core/constraints/projection_checks.h"

namespace deform::relations_test {
namespace {

using namespace test;

Points joined(const Points& a, const Points& b) {
  Points all = a;
  all.insert(all.end(), b.begin(), b.end());
  return all;
}

/// A 5 x 4 patch in the plane through `at` that u and v span.
Points patch(const Vec3& at, const Vec3& u, const Vec3& v) {
  Points points;
  for (int i = 0; i < 5; ++i) {
    for (int j = 0; j < 4; ++j) {
      Vec3 p = at;
      for (std::size_t k = 0; k < 3; ++k) p[k] += 0.1 * i * u[k] + (0.07 * j + 0.003 * i * j) * v[k];
      points.push_back(p);
    }
  }
  return points;
}

TEST(Parallel, IsTheProjection) {
  Points x = joined(patch({0, 0, 0}, {1, 0, 0}, {0, 1, 0}), patch({0.7, 0.2, 0.5}, {0.6, 0.8, 0}, {-0.8, 0.6, 0}));
  x = joined(x, patch({0, 0.7, -0.3}, {1, 0, 0}, {0, 2, 0}));
  expect_projection(*parallel_projection({20, 20, 20}), moved(x, tilted()), 0.005);
}

TEST(Parallel, PlanesAreParallelNotEqual) {
  const Points x = noisy(joined(patch({0, 0, 0}, {1, 0, 0}, {0, 1, 0}), patch({0, 0, 0.5}, {1, 0, 0.1}, {0, 1, 0})), 0.01, 5);
  const Points y = projected(*parallel_projection({20, 20}), x).points;
  const auto normal = [&](std::size_t begin) {
    const auto at = [&](std::size_t i) { return Eigen::Vector3d(y[begin + i][0], y[begin + i][1], y[begin + i][2]); };
    return (at(19) - at(0)).cross(at(3) - at(16)).normalized().eval();
  };
  EXPECT_NEAR(normal(0).cross(normal(20)).norm(), 0, 1e-12);
}

TEST(Orthogonal, IsTheProjection) {
  const Points x = joined(patch({0, 0, 0}, {1, 0, 0}, {0, 1, 0}), patch({0.7, 0.2, 0.5}, {0.6, 0.8, 0}, {0, 0, 1}));
  expect_projection(*orthogonal_projection({20, 20}), moved(x, tilted()), 0.005);
}

TEST(Orthogonal, BruteForceOverBothNormals) {
  const Points x = noisy(joined(patch({0, 0, 0}, {1, 0, 0}, {0, 1, 0}), patch({0, 0, 0}, {0.6, 0.8, 0}, {0.5, 0, 0.5})), 0.05, 8);
  Eigen::Matrix3d scatter[2];
  for (std::size_t r = 0; r < 2; ++r) {
    Eigen::MatrixXd X(20, 3);
    for (Eigen::Index i = 0; i < 20; ++i) {
      for (Eigen::Index k = 0; k < 3; ++k) X(i, k) = x[20 * r + static_cast<std::size_t>(i)][static_cast<std::size_t>(k)];
    }
    X.rowwise() -= X.colwise().mean().eval();
    scatter[r] = X.transpose() * X;
  }
  double best = 1e300;
  for (int i = 0; i <= 60; ++i) {
    for (int j = 0; j < 120; ++j) {
      for (int k = 0; k < 60; ++k) {
        const Eigen::Matrix3d R = (Eigen::AngleAxisd(2 * M_PI * j / 120, Eigen::Vector3d::UnitZ()) *
                                   Eigen::AngleAxisd(M_PI * i / 60, Eigen::Vector3d::UnitY()) *
                                   Eigen::AngleAxisd(M_PI * k / 60, Eigen::Vector3d::UnitZ()))
                                      .toRotationMatrix();
        best = std::min(best, R.col(2).dot(scatter[0] * R.col(2)) + R.col(0).dot(scatter[1] * R.col(0)));
      }
    }
  }
  const double energy = projected(*orthogonal_projection({20, 20}), x).energy;
  EXPECT_LE(energy, best);
  EXPECT_GE(energy, 0.97 * best) << "the raster is finer than that";
}

TEST(Relations, DegenerateSets) {
  const Points point(40, Vec3{0.1, 0.2, 0.3});
  Points line;
  for (int i = 0; i < 40; ++i) line.push_back({0.01 * i, 0.02 * i, 0.3});
  std::vector<std::uint32_t> partner(40);
  for (std::uint32_t i = 0; i < 40; ++i) partner[i] = 39 - i;
  std::vector<PointPair> pairs;
  for (std::uint32_t i = 0; i < 20; ++i) pairs.push_back({i, i + 20, 0.1, 0.2, {0, 0, 1}});
  for (const Points& x : {point, line, joined(patch({0, 0, 0}, {1, 0, 0}, {0, 1, 0}), Points(20, Vec3{1, 2, 3}))}) {
    expect_survives(*parallel_projection({20, 20}), x);
    expect_survives(*orthogonal_projection({20, 20}), x);
    expect_survives(*symmetric_projection(partner), x);
    expect_survives(*distance_projection(pairs, 40), x);
    expect_survives(*largest_extent_projection({0, 0, 1}, 0.1, 40), x);
  }
  // Coincident points part along the direction that is given.
  const Points apart = projected(*distance_projection(pairs, 40), point).points;
  EXPECT_NEAR(apart[0][2] - apart[20][2], 0.1, 1e-15);
}

/// 15 points, their mirror images in x = 0, and 5 points in that plane.
Points symmetric(std::vector<std::uint32_t>& partner) {
  const Points half = along(Points(15, Vec3{0.5, 0, 0}), 0.1, normal_noise(15, 40));
  Points x = half;
  partner.resize(35);
  for (std::uint32_t i = 0; i < 15; ++i) {
    x.push_back({-half[i][0], half[i][1], half[i][2]});
    partner[i] = 15 + i;
    partner[15 + i] = i;
  }
  for (std::uint32_t i = 30; i < 35; ++i) {
    x.push_back({0, 0.1 * i - 3, 0.02 * i * i - 20});
    partner[i] = i;
  }
  return x;
}

TEST(Symmetric, IsTheProjection) {
  std::vector<std::uint32_t> partner;
  const Points exact = moved(symmetric(partner), tilted());
  const auto projection = symmetric_projection(partner);
  expect_unmoved(*projection, exact);
  const Points x = noisy(exact, 0.03, 2);
  expect_nearest(*projection, x);
  expect_derivative(*projection, x);
  expect_equivariant(*projection, x);
  expect_same_from_any_start(*projection, x);
  expect_linearization(*projection, x, 1e-5, 1e-7);
}

TEST(Symmetric, PairsAreFound) {
  std::vector<std::uint32_t> expected;
  const Points x = moved(symmetric(expected), tilted());
  const auto plane = find_mirror_plane(x, x.size(), 1e-6);
  ASSERT_TRUE(plane);
  const MirrorPairs pairs = mirror_pairs(x, x.size(), *plane, 1e-6);
  EXPECT_EQ(pairs.unmatched, 0u);
  EXPECT_EQ(pairs.partner, expected);
  // Two regions, and one with a point too many.
  Points two(x.begin(), x.begin() + 30);
  const auto between = find_mirror_plane(two, 15, 1e-6);
  ASSERT_TRUE(between);
  EXPECT_EQ(mirror_pairs(two, 15, *between, 1e-6).partner, std::vector<std::uint32_t>(expected.begin(), expected.begin() + 30));
  Points more = x;
  more.push_back({3, 3, 3});
  const MirrorPairs missing = mirror_pairs(more, more.size(), *plane, 1e-6);
  EXPECT_EQ(missing.unmatched, 1u);
  EXPECT_EQ(missing.first_unmatched, 35u);
}

TEST(Pairing, NearestAgainstAllPairs) {
  const Points a = normal_noise(300, 1), b = normal_noise(500, 2);
  Points grid;  // with many equal distances
  for (int i = 0; i < 512; ++i) grid.push_back({i % 8 * 1.0, i / 8 % 8 * 1.0, i / 64 * 1.0});
  Points between = grid;
  for (Vec3& p : between) p[0] += 0.5;
  const auto check = [](const Points& from, const Points& to) {
    const auto nearest = nearest_points(from, to);
    for (std::size_t i = 0; i < from.size(); ++i) {
      std::uint32_t best = 0;
      for (std::uint32_t k = 1; k < to.size(); ++k) {
        if (squared({from[i]}, {to[k]}) < squared({from[i]}, {to[best]})) best = k;
      }
      ASSERT_EQ(nearest[i], best);
    }
  };
  check(a, b);
  check(between, grid);
  check(a, Points(3, Vec3{1, 1, 1}));
}

TEST(Distance, EveryPairByHalf) {
  std::vector<PointPair> pairs;
  for (std::uint32_t i = 0; i < 15; ++i) pairs.push_back({i, i + 20, 0.1, 0.1, {0, 0, 1}});
  const auto projection = distance_projection(pairs, 40);
  const Points x = noisy(joined(patch({0, 0, 0}, {1, 0, 0}, {0, 1, 0}), patch({0, 0, 0.1}, {1, 0, 0}, {0, 1, 0})), 0.02, 3);
  const Projected p = projected(*projection, x);
  for (std::size_t i = 0; i < 15; ++i) EXPECT_NEAR(std::sqrt(squared({p.points[i]}, {p.points[i + 20]})), 0.1, 1e-15);
  for (std::size_t i = 15; i < 20; ++i) EXPECT_EQ(p.points[i], x[i]);
  expect_nearest(*projection, x);
  expect_derivative(*projection, x);
  expect_equivariant(*projection, x);
  expect_same_from_any_start(*projection, x);
  expect_linearization(*projection, x, 1e-5, 1e-7);
}

TEST(Distance, BoundsHoldOnlyWhatBreaksThem) {
  const auto projection = distance_projection({{0, 1, 0.2, 0.5, {0, 0, 1}}, {2, 3, 0.2, 0.5, {0, 0, 1}}, {4, 5, 0.2, 0.5}}, 6);
  const Points x = {{0, 0, 0}, {0, 0, 0.1}, {0, 1, 0}, {0.3, 1, 0}, {0, 2, 0}, {0, 2.9, 0}};
  const Points expected = {{0, 0, -0.05}, {0, 0, 0.15}, {0, 1, 0}, {0.3, 1, 0}, {0, 2.2, 0}, {0, 2.7, 0}};
  EXPECT_LE(largest(projected(*projection, x).points, expected), 1e-15);
  expect_derivative(*projection, x);
}

TEST(Distance, ReportsTheErrorOfTheDistanceItself) {
  const auto projection = distance_projection({{0, 1, 0.2, 0.5, {0, 0, 1}}, {2, 3, 0.3, 0.3, {0, 0, 1}}}, 5);
  const Points x = {{0, 0, 0}, {0, 0, 0.6}, {0, 1, 0}, {0, 1, 0.1}, {5, 5, 5}};
  const Projection::Misfit misfit = projection->misfit(x, projected(*projection, x).points);
  EXPECT_NEAR(misfit.largest, 0.2, 1e-15);
  EXPECT_NEAR(misfit.squares, 0.1 * 0.1 + 0.2 * 0.2, 1e-15);
  EXPECT_EQ(misfit.count, 2u) << "pairs, not points";
}

/// What is met exactly is held there all the same.
TEST(Distance, HoldsPairsThatAreMet) {
  const auto projection = distance_projection({{0, 1, 0.5, 0.5, {0, 0, 1}}}, 2);
  const Points x = {{0, 0, 0}, {0, 0, 0.5}}, apart = {{0, 0, -1}, {0, 0, 1}};
  Points moved(2);
  projection->derivative(x, {}, apart, moved);
  EXPECT_LE(largest(moved, Points(2)), 1e-15);
  const Linearization linear = projection->linearize(x, {});
  EXPECT_NE(linear.normals[0], Vec3{});
}

/// The least over the offset by a fine raster.
double brute_extent(const Points& x, double value, const ExtentEnds* ends) {
  double best = 1e300;
  for (int k = 0; k <= 400000; ++k) {
    const double h = -2 + 4.0 * k / 400000;
    double sum = 0;
    if (ends == nullptr) {
      for (const Vec3& p : x) sum += std::pow(std::max(0.0, p[2] - h - value) + std::max(0.0, h - p[2]), 2);
    } else {
      for (const std::size_t i : ends->lower) sum += std::pow(std::max(0.0, x[i][2] - h), 2);
      for (const std::size_t i : ends->upper) sum += std::pow(std::max(0.0, h + value - x[i][2]), 2);
    }
    best = std::min(best, sum);
  }
  return best;
}

TEST(Extent, MaximumIsTheProjection) {
  const Points x = noisy(Points(30, Vec3{}), 0.3, 12);
  for (const double value : {0.0, 0.2, 0.7}) {
    const auto projection = largest_extent_projection({0, 0, 1}, value, 30);
    const Projected p = projected(*projection, x);
    EXPECT_NEAR(p.energy, brute_extent(x, value, nullptr), 1e-8);
    double low = 1e300, high = -1e300;
    for (const Vec3& y : p.points) low = std::min(low, y[2]), high = std::max(high, y[2]);
    EXPECT_NEAR(high - low, value, 1e-14);
    expect_nearest(*projection, x);
    expect_derivative(*projection, x);
    expect_linearization(*projection, x, 1e-7, 1e-6);
    expect_same_from_any_start(*projection, x);
  }
  EXPECT_EQ(projected(*largest_extent_projection({0, 0, 1}, 5, 30), x).points, x);
}

TEST(Extent, MinimumHoldsTheEndsApart) {
  Points rest = normal_noise(30, 5);
  const ExtentEnds ends = extent_ends(rest, {0, 0, 1}, 0.25);
  ASSERT_GT(ends.lower.size(), 1u);
  ASSERT_GT(ends.upper.size(), 1u);
  const Points x = noisy(rest, 0.2, 6);
  for (const double value : {1.0, 3.0}) {
    const auto projection = least_extent_projection({0, 0, 1}, value, ends, 30);
    const Projected p = projected(*projection, x);
    EXPECT_NEAR(p.energy, brute_extent(x, value, &ends), 1e-7);
    for (const std::size_t i : ends.upper) {
      for (const std::size_t k : ends.lower) EXPECT_GE(p.points[i][2] - p.points[k][2], value - 1e-12);
    }
    expect_nearest(*projection, x);
    expect_derivative(*projection, x);
    expect_linearization(*projection, x, 1e-7, 1e-6);
  }
  EXPECT_EQ(projected(*least_extent_projection({0, 0, 1}, 0.01, ends, 30), x).points, x);
}

/// As documented: an extent that is off by e is e n / (m + n) for the m points of one end and e m / (m + n) for the n of the
/// other, and points that are free or within bounds count in the mean.
TEST(Extent, MisfitIsSharedByTheEnds) {
  const std::vector<Vec3> x{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0, 1, 1}, {1, 1, 0.5}};  // 3 below, 1 above, and one between
  const auto misfit = [&](const Projection& of) {
    std::vector<Vec3> onto(x.size());
    ShapeParameters shape;
    of.project(x, onto, shape);
    return of.misfit(x, onto);
  };
  const double e = 0.6;
  const std::unique_ptr<const Projection> both[] = {largest_extent_projection({0, 0, 1}, 1 - e, x.size()),
                                                    least_extent_projection({0, 0, 1}, 1 + e, {{0, 1, 2}, {3}}, x.size())};
  for (const auto& projection : both) {
    const Projection::Misfit got = misfit(*projection);
    EXPECT_NEAR(got.largest, e * 3 / 4, 1e-14);
    EXPECT_NEAR(got.squares, 3 * std::pow(e / 4, 2) + std::pow(e * 3 / 4, 2), 1e-14);
    EXPECT_EQ(got.count, x.size());
  }
}

}  // namespace
}  // namespace deform::relations_test
