// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 8.3, figure 8.2: dense points, farthest points, Lloyd's method.
#include "core/numerics/sampling/sampling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <set>
#include <vector>

#include "core/numerics/sampling/farthest_points.h"
#include "core/numerics/sampling/point_tree.h"
#include "tests/core/numerics/random_points.h"

namespace deform::sampling_test {
namespace {

/// Triangles over points of their own; the unit square in two unlike triangles and one without area.
class Triangles : public Pieces {
 public:
  std::vector<std::array<Vec3, 3>> corners{{Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{1, 1, 0}},
                                           {Vec3{0.5, 0.5, 0}, Vec3{0.5, 0.5, 0}, Vec3{0.7, 0.7, 0}},
                                           {Vec3{0, 0, 0}, Vec3{1, 1, 0}, Vec3{0, 1, 0}}};
  std::size_t count() const override { return corners.size(); }
  double measure(std::size_t piece) const override {
    const auto& [a, b, c] = corners[piece];
    return 0.5 * std::abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
  }
  Vec3 place(std::size_t piece, const Vec3& random) const override {
    const auto& [a, b, c] = corners[piece];
    return place_in_triangle(a, b, c, random);
  }
};

class UnitCube : public Pieces {
 public:
  std::size_t count() const override { return 1; }
  double measure(std::size_t /*piece*/) const override { return 1; }
  Vec3 place(std::size_t /*piece*/, const Vec3& random) const override { return {random[0], random[1], random[2]}; }
};

/// Distances to the nearest other one.
std::vector<double> nearest(const std::vector<Vec3>& points) {
  const PointTree tree(points);
  std::vector<double> distances;
  for (const Vec3& x : points) distances.push_back(std::sqrt(tree.kth_square(x, 2)));
  return distances;
}
double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}
double evenness(const std::vector<Vec3>& points) {
  const std::vector<double> distances = nearest(points);
  return *std::min_element(distances.begin(), distances.end()) / mean(distances);
}

/// What Lloyd's method makes smaller: the mean squared distance from a dense point to its sample.
double mean_square(const std::vector<Vec3>& samples, const DensePoints& dense) {
  const PointTree tree(samples);
  std::vector<double> squares;
  for (const Vec3& x : dense.points) squares.push_back(tree.nearest(x).square);
  return mean(squares);
}
/// Standard deviation of the Voronoi areas over their mean.
double share_spread(const std::vector<Vec3>& samples, const DensePoints& dense) {
  std::vector<double> squares;
  const auto count = static_cast<double>(samples.size());
  for (const double share : voronoi_shares(samples, dense)) {
    squares.push_back((share * count / dense.area - 1) * (share * count / dense.area - 1));
  }
  return std::sqrt(mean(squares));
}

DensePoints square_and_cube(std::size_t surface, std::size_t volume, std::uint64_t seed, int threads = 0) {
  RunContext context;
  context.threads = threads;
  DensePoints dense;
  const UniformSamples flat = sample_uniformly(Triangles(), surface, seed, context);
  const UniformSamples solid = sample_uniformly(UnitCube(), volume, seed + 1, context);
  dense.points = flat.points;
  dense.points.insert(dense.points.end(), solid.points.begin(), solid.points.end());
  dense.surface = flat.points.size();
  dense.area = flat.measure;
  dense.volume = solid.measure;
  return dense;
}

TEST(SampleUniformly, FillsPiecesByTheirMeasure) {
  const UniformSamples samples = sample_uniformly(Triangles(), 10000, 7);
  EXPECT_DOUBLE_EQ(samples.measure, 1);
  ASSERT_EQ(samples.points.size(), 10000u);
  std::array<int, 16> in_cell{};
  for (const Vec3& x : samples.points) {
    ASSERT_TRUE(x[0] >= 0 && x[0] <= 1 && x[1] >= 0 && x[1] <= 1 && x[2] == 0);
    ++in_cell[static_cast<std::size_t>(std::min(3.0, 4 * x[0])) * 4 + static_cast<std::size_t>(std::min(3.0, 4 * x[1]))];
  }
  // 625 are expected in each; 24 is one standard deviation.
  for (const int count : in_cell) EXPECT_NEAR(count, 625, 5 * 24);
}

TEST(SampleUniformly, NothingToSample) {
  Triangles none;
  none.corners.clear();
  EXPECT_TRUE(sample_uniformly(none, 100, 1).points.empty());
  Triangles degenerate;
  degenerate.corners = {{Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{2, 0, 0}}};
  EXPECT_TRUE(sample_uniformly(degenerate, 100, 1).points.empty());
}

TEST(SampleUniformly, TetrahedraAreFilledEvenly) {
  const Vec3 a{0, 0, 0}, b{2, 0, 0}, c{0, 3, 0}, d{0, 0, 4};
  Vec3 middle{};
  const auto numbers = test::random_points(20000, 3);
  for (const Vec3& u : numbers) {
    const Vec3 x = place_in_tetrahedron(a, b, c, d, u);
    ASSERT_TRUE(x[0] >= 0 && x[1] >= 0 && x[2] >= 0 && x[0] / 2 + x[1] / 3 + x[2] / 4 <= 1 + 1e-12);
    for (std::size_t k = 0; k < 3; ++k) middle[k] += x[k] / 20000;
  }
  // The mean of a coordinate has a standard deviation of length * sqrt(3/80) / sqrt(20000).
  EXPECT_NEAR(middle[0], 0.5, 0.015);
  EXPECT_NEAR(middle[1], 0.75, 0.02);
  EXPECT_NEAR(middle[2], 1.0, 0.03);
}

TEST(FarthestPoints, FastOrderIsThatOfTheDefinition) {
  auto points = test::random_points(3000, 11);
  points.resize(3100, points[5]);  // coincident ones
  EXPECT_EQ(fast_farthest_points(points, 400, {}), farthest_point_order(points, 400));
  EXPECT_EQ(fast_farthest_points(points, 9999, {}).size(), 3000u);  // every place once
}

TEST(FarthestPoints, KeepAwayFromThoseTaken) {
  const auto points = test::random_points(4000, 12);
  const std::vector<Vec3> taken(points.begin(), points.begin() + 100);
  const auto order = fast_farthest_points(points, 200, taken);
  ASSERT_EQ(order.size(), 200u);
  std::vector<Vec3> all = taken;
  double before = 1e300;
  for (const std::uint32_t i : order) {
    const double distance = std::sqrt(PointTree(all).nearest(points[i]).square);
    EXPECT_LE(distance, before * (1 + 1e-15));
    before = distance;
    all.push_back(points[i]);
  }
  EXPECT_TRUE(fast_farthest_points(taken, 10, taken).empty());
}

TEST(SurfaceSampling, LloydMakesSamplesEvenOnASurface) {
  const DensePoints dense = square_and_cube(40000, 0, 5);
  SampleOptions options;
  options.surface = 1000;
  options.relaxation_steps = 0;
  const std::vector<Vec3> before = spread_samples(dense, options).points;
  options.relaxation_steps = SampleOptions().relaxation_steps;
  const Samples samples = spread_samples(dense, options);
  EXPECT_EQ(samples.points.size(), 1000u);
  EXPECT_EQ(samples.surface, 1000u);
  // Farthest points have no two closer than the last one was: 0.93, which Lloyd's method gives up for even areas (0.73).
  EXPECT_GE(evenness(samples.points), 0.6);
  EXPECT_LT(mean_square(samples.points, dense), 0.97 * mean_square(before, dense));
  EXPECT_LT(share_spread(samples.points, dense), 0.85 * share_spread(before, dense));
  RecordProperty("before", std::to_string(evenness(before)));
  RecordProperty("after", std::to_string(evenness(samples.points)));
}

TEST(SurfaceSampling, LloydRaisesTheRatioOfRandomSamples) {
  const DensePoints dense = square_and_cube(20000, 20000, 8);
  SampleOptions options;
  options.surface = 300;
  options.volume = 500;
  const Samples samples = spread_samples(dense, options);
  ASSERT_EQ(samples.points.size(), 800u);
  EXPECT_EQ(samples.surface, 300u);
  const std::vector<Vec3> plain(dense.points.begin(), dense.points.begin() + 300);
  const std::vector<Vec3> on_surface(samples.points.begin(), samples.points.begin() + 300);
  EXPECT_GE(evenness(on_surface), 0.6);
  EXPECT_GT(evenness(on_surface), evenness(plain));
  // They stay on the surface, to a part of their spacing (0.05), and closer to each other than those in the volume.
  for (const Vec3& x : on_surface) EXPECT_LT(x[2], 0.02);
  const double share = 1.0 / 500;
  EXPECT_LT(std::sqrt(PointTree(on_surface).kth_square(on_surface[0], 2)), std::cbrt(share));
}

/// Farthest points and Lloyd's method as they are defined, over all pairs of points.
std::vector<Vec3> samples_by_definition(const DensePoints& dense, const SampleOptions& options) {
  const auto nearest_of = [](const Vec3& x, const std::vector<Vec3>& samples) {
    std::size_t best = 0;
    for (std::size_t j = 1; j < samples.size(); ++j) {
      if (test::squared_distance(x, samples[j]) < test::squared_distance(x, samples[best])) best = j;
    }
    return best;
  };
  const std::vector<Vec3> flat(dense.points.begin(), dense.points.begin() + static_cast<std::ptrdiff_t>(dense.surface));
  std::vector<Vec3> samples;
  for (const std::uint32_t i : farthest_point_order(flat, options.surface)) samples.push_back(flat[i]);
  for (std::size_t count = 0; count < options.volume; ++count) {
    std::size_t farthest = dense.surface;
    double most = -1;
    for (std::size_t i = dense.surface; i < dense.points.size(); ++i) {
      const double square = test::squared_distance(dense.points[i], samples[nearest_of(dense.points[i], samples)]);
      if (square > most) most = square, farthest = i;
    }
    samples.push_back(dense.points[farthest]);
  }
  for (int step = 0; step < options.relaxation_steps; ++step) {
    std::vector<Vec3> sums(samples.size(), Vec3{});
    std::vector<double> weights(samples.size(), 0.0);
    for (std::size_t i = 0; i < dense.points.size(); ++i) {
      const std::size_t j = nearest_of(dense.points[i], samples);
      const double weight = i < dense.surface ? options.surface_weight : 1;
      weights[j] += weight;
      for (std::size_t k = 0; k < 3; ++k) sums[j][k] += weight * dense.points[i][k];
    }
    for (std::size_t j = 0; j < samples.size(); ++j) {
      for (std::size_t k = 0; k < 3 && weights[j] > 0; ++k) samples[j][k] = sums[j][k] / weights[j];
    }
  }
  return samples;
}

TEST(SurfaceSampling, SamplesAreThoseOfTheDefinition) {
  const DensePoints dense = square_and_cube(600, 900, 13);
  SampleOptions options;
  options.surface = 40;
  options.volume = 60;
  for (const int steps : {0, 1, 12}) {
    for (const double weight : {1.0, 10.0}) {
      options.relaxation_steps = steps;
      options.surface_weight = weight;
      const std::vector<Vec3> samples = spread_samples(dense, options).points, wanted = samples_by_definition(dense, options);
      ASSERT_EQ(samples.size(), wanted.size());
      // Sums of 1500 points in [0, 1], in another order at most.
      for (std::size_t j = 0; j < samples.size(); ++j) EXPECT_LT(test::squared_distance(samples[j], wanted[j]), 1e-24) << j;
    }
  }
}

// The first sample moves between its points, which are then nearer to the two others: none is left to it after the first step.
TEST(SurfaceSampling, SamplesWithoutPointsOfTheirOwnStayWhereTheyAre) {
  DensePoints dense;
  dense.points = {{6, 1, 0}, {2, 7, 0}, {6, 3, 0}, {0, 7, 0}, {8, 8, 0}, {3, 8, 0}};
  dense.surface = 3;
  SampleOptions options;
  options.surface = 1;
  options.volume = 2;
  options.relaxation_steps = 1;
  const Vec3 after_one_step = spread_samples(dense, options).points.at(0);
  options.relaxation_steps = 2;
  const std::vector<Vec3> samples = spread_samples(dense, options).points, wanted = samples_by_definition(dense, options);
  EXPECT_EQ(samples.at(0), after_one_step);
  for (std::size_t j = 0; j < 3; ++j) EXPECT_LT(test::squared_distance(samples.at(j), wanted.at(j)), 1e-24) << j;
}

TEST(SurfaceSampling, SameSeedSameSamplesForAnyNumberOfThreads) {
  SampleOptions options;
  options.surface = 200;
  options.volume = 200;
  RunContext one, two;
  one.threads = 1;
  two.threads = 2;
  const DensePoints dense = square_and_cube(9000, 9000, 4, 1);
  EXPECT_EQ(dense.points, square_and_cube(9000, 9000, 4, 2).points);
  EXPECT_NE(dense.points, square_and_cube(9000, 9000, 5, 2).points);
  const Samples first = spread_samples(dense, options, one);
  EXPECT_EQ(first.points, spread_samples(dense, options, two).points);
  EXPECT_EQ(voronoi_shares(first.points, dense, one), voronoi_shares(first.points, dense, two));
}

TEST(VoronoiShares, AddUpToTheVolumeOrTheArea) {
  const DensePoints solid = square_and_cube(3000, 5000, 2), flat = square_and_cube(3000, 0, 2);
  const auto samples = test::random_points(50, 1);
  const auto sum = [](const std::vector<double>& values) { return std::accumulate(values.begin(), values.end(), 0.0); };
  EXPECT_NEAR(sum(voronoi_shares(samples, solid)), solid.volume, 1e-12);
  EXPECT_NEAR(sum(voronoi_shares(samples, flat)), flat.area, 1e-12);
}

TEST(Samples, AreNoMoreThanThereArePlaces) {
  DensePoints dense;
  dense.points = {{0, 0, 0}, {0, 0, 0}, {1, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  dense.surface = 5;
  dense.area = 1;
  SampleOptions options;
  options.surface = 100;
  const Samples samples = spread_samples(dense, options);
  EXPECT_EQ(samples.points.size(), 3u);
  EXPECT_EQ(std::set<Vec3>(samples.points.begin(), samples.points.end()).size(), 3u);
}

TEST(Samples, CanBeCancelled) {
  const DensePoints dense = square_and_cube(2000, 0, 1);
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  SampleOptions options;
  options.surface = 100;
  EXPECT_THROW(spread_samples(dense, options, context), std::exception);
}

}  // namespace
}  // namespace deform::sampling_test
