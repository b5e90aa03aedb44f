// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/compact_levels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>
#include <utility>
#include <vector>

#include "core/numerics/kernels/tiles.h"
#include "core/numerics/sampling/farthest_points.h"

namespace deform::compact_levels_test {
namespace {

/// A wall of 40 x 40 points in z = 0, over which stand layers of thickness 1e-3, 1e-5 and 1e-9 at one of its edges; of all these
/// sixty are known.
struct Wall {
  std::vector<Vec3> places;
  std::vector<std::uint32_t> known;
  std::vector<char> bound;

  explicit Wall(std::size_t count = 40) {
    for (std::size_t j = 0; j < count; ++j) {
      for (std::size_t i = 0; i < count; ++i) {
        places.push_back({static_cast<double>(i) / static_cast<double>(count - 1),
                          static_cast<double>(j) / static_cast<double>(count - 1), 0});
      }
    }
    for (std::size_t i = 0; i < count; ++i) {
      for (const double height : {1e-9, 1e-5, 1e-3}) places.push_back({places[i][0], 0, height});
    }
    known = farthest_point_order(places, 60);
    bound.assign(places.size(), 1);
  }
  std::vector<CompactLevel> levels() const { return choose_levels({places, known, bound}, {}); }
};

/// What a smooth function of size 1 may leave beside the known places: zero there, and about as smooth as they are dense.
double remainder(const Wall& wall, const Vec3& x) {
  double square = 1;
  for (const std::uint32_t i : wall.known) {
    const Vec3& k = wall.places[i];
    square = std::min(square, (x[0] - k[0]) * (x[0] - k[0]) + (x[1] - k[1]) * (x[1] - k[1]) + (x[2] - k[2]) * (x[2] - k[2]));
  }
  return std::sin(40 * std::sqrt(square)) * std::cos(5 * x[0] - 3 * x[1]);
}

/// The value of an interpolant at places, in tiles.
std::vector<double> values(const CompactLevels& levels, const Eigen::MatrixXd& coefficients, std::span<const Vec3> at) {
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = coefficients;
  const auto columns = static_cast<std::size_t>(rows.cols());
  const TiledPoints tiled(at);
  std::vector<double> result, tile(columns * tile_size);
  for (std::size_t t = 0; t < tiled.tiles(); ++t) {
    std::fill(tile.begin(), tile.end(), 0.0);
    levels.add_values(tiled.tile(t), rows.data(), columns, tile.data());
    for (std::size_t i = t * tile_size; i < std::min(at.size(), (t + 1) * tile_size); ++i) {
      for (std::size_t c = 0; c < columns; ++c) result.push_back(tile[c * tile_size + i % tile_size]);
    }
  }
  return result;
}

Eigen::MatrixXd remainders(const Wall& wall, const CompactLevels& levels) {
  Eigen::MatrixXd result(static_cast<Eigen::Index>(levels.used().size()), 1);
  for (std::size_t i = 0; i < levels.used().size(); ++i) {
    result(static_cast<Eigen::Index>(i), 0) = remainder(wall, wall.places[levels.used()[i]]);
  }
  return result;
}

TEST(CompactLevels, levels_get_finer_until_they_have_all_bound_places) {
  Wall wall;
  wall.places.push_back(wall.places[777]);  // coincides
  wall.bound.push_back(1);
  const std::vector<CompactLevel> levels = wall.levels();
  ASSERT_GE(levels.size(), 5u);
  std::vector<char> met(wall.places.size());
  for (std::size_t l = 0; l < levels.size(); ++l) {
    EXPECT_LE(levels[l].radius, l == 0 ? 1 : levels[l - 1].radius / 1.9);
    EXPECT_TRUE(std::is_sorted(levels[l].members.begin(), levels[l].members.end()));
    // Places of one level are not close to each other for its radius, so that its matrix is well-conditioned.
    for (std::size_t a = 0; a < levels[l].members.size(); ++a) {
      met[levels[l].members[a]] = 1;
      for (std::size_t b = 0; b < a; ++b) {
        const Vec3 &x = wall.places[levels[l].members[a]], &y = wall.places[levels[l].members[b]];
        EXPECT_GE(std::hypot(x[0] - y[0], x[1] - y[1], x[2] - y[2]), 0.2499 * levels[l].radius);
      }
    }
  }
  const auto left_out = [&](std::size_t i) {
    return !met[i] && std::find(wall.known.begin(), wall.known.end(), i) == wall.known.end();
  };
  for (std::size_t i = 0; i + 1 < met.size(); ++i) EXPECT_FALSE(left_out(i) && i != 777) << i;
  EXPECT_TRUE(left_out(777) != left_out(met.size() - 1));
}

TEST(CompactLevels, places_that_are_not_bound_count_next_to_bound_ones_only) {
  Wall wall;
  for (std::size_t i = 0; i < wall.places.size(); ++i) wall.bound[i] = wall.places[i][0] < 0.03;
  const std::vector<CompactLevel> levels = wall.levels();
  ASSERT_FALSE(levels.empty());
  std::size_t others = 0;
  for (const CompactLevel& level : levels) {
    for (const std::uint32_t i : level.members) {
      EXPECT_LE(wall.places[i][0], 1.0 / 39 + (1 + 2e-9) * level.radius);
      others += wall.bound[i] ? 0 : 1;
    }
  }
  EXPECT_GT(others, 0u);
  std::fill(wall.bound.begin(), wall.bound.end(), char{0});
  EXPECT_TRUE(wall.levels().empty());
}

TEST(CompactLevels, meets_the_values_at_all_places_however_close) {
  const Wall wall;
  const CompactLevels levels(wall.places, wall.levels(), {});
  const Eigen::MatrixXd data = remainders(wall, levels);
  const Eigen::MatrixXd coefficients = levels.coefficients(data, {});
  const std::vector<double> at_used = values(levels, coefficients, levels.used_places());
  for (std::size_t i = 0; i < at_used.size(); ++i) EXPECT_NEAR(at_used[i], data(static_cast<Eigen::Index>(i), 0), 1e-13);
  std::vector<Vec3> known;
  for (const std::uint32_t i : wall.known) known.push_back(wall.places[i]);
  for (const double value : values(levels, coefficients, known)) EXPECT_NEAR(value, 0, 1e-13);
  EXPECT_LT(levels.rounding(coefficients.data(), 1, levels.used_places()), 1e-13);
  EXPECT_GT(levels.rounding(coefficients.data(), 1, levels.used_places()), 1e-16);
}

// The layers of cells over a wall: what is added to their lower and upper points must differ by less than their thickness.
TEST(CompactLevels, thin_layers_over_the_places_move_with_them) {
  const Wall wall;
  std::vector<CompactLevel> chosen = wall.levels();
  const CompactLevels levels(wall.places, chosen, {});
  const Eigen::MatrixXd coefficients = levels.coefficients(remainders(wall, levels), {});
  std::vector<Vec3> low, high;
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> uniform(0.1, 0.9);
  for (int k = 0; k < 500; ++k) {
    low.push_back({uniform(random), uniform(random), 0});
    high.push_back({low.back()[0], low.back()[1], 1e-4});
  }
  const std::vector<double> below = values(levels, coefficients, low), above = values(levels, coefficients, high);
  double largest = 0;
  for (std::size_t i = 0; i < low.size(); ++i) {
    largest = std::max(largest, std::abs(below[i]));
    // The slope along the normal is at most as steep as that of a function of size 1 whose finest level here has this radius.
    EXPECT_LT(std::abs(above[i] - below[i]), 1e-4) << i;
  }
  EXPECT_GT(largest, 0.5);
  EXPECT_LT(largest, 1.5);
  for (const double value : values(levels, coefficients, std::vector<Vec3>{{0.5, 0.5, chosen[0].radius}, {-1, 0, 0}})) {
    EXPECT_EQ(value, 0);
  }
}

TEST(CompactLevels, the_adjoint_is_the_transpose) {
  const Wall wall(20);
  const CompactLevels levels(wall.places, wall.levels(), {});
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd data(static_cast<Eigen::Index>(levels.used().size()), 3);
  for (Eigen::Index i = 0; i < data.size(); ++i) data(i) = normal(random);
  std::vector<Vec3> points(333), X(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i] = {0.5 + 0.3 * normal(random), 0.5 + 0.3 * normal(random), 0.01 * normal(random)};
    X[i] = {normal(random), normal(random), normal(random)};
  }
  const std::vector<double> forward = values(levels, levels.coefficients(data, {}), points);
  const Eigen::MatrixXd back = levels.adjoint(points, X, {});
  for (std::size_t k = 0; k < 3; ++k) {
    double left = 0, right = 0, size = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      left += forward[3 * i + k] * X[i][k];
      size += std::abs(forward[3 * i + k] * X[i][k]);
    }
    for (Eigen::Index j = 0; j < data.rows(); ++j) {
      right += back(j, static_cast<Eigen::Index>(k)) * data(j, static_cast<Eigen::Index>(k));
    }
    EXPECT_NEAR(left, right, 1e-11 * size);
    EXPECT_GT(size, 1);
  }
}

TEST(CompactLevels, columns_and_threads_do_not_matter) {
  const Wall wall;
  const CompactLevels levels(wall.places, wall.levels(), {});
  Eigen::MatrixXd data(static_cast<Eigen::Index>(levels.used().size()), 3);
  for (Eigen::Index i = 0; i < data.size(); ++i) data(i) = std::sin(static_cast<double>(i));
  RunContext one;
  one.threads = 1;
  const Eigen::MatrixXd together = levels.coefficients(data, {}), alone = levels.coefficients(data.col(1), one);
  EXPECT_EQ(std::memcmp(together.col(1).data(), alone.data(), static_cast<std::size_t>(alone.size()) * sizeof(double)), 0);
}

TEST(CompactLevels, its_size_is_known_before) {
  const Wall wall;
  const std::vector<CompactLevel> chosen = wall.levels();
  const CompactLevels::Bytes estimate = CompactLevels::estimate(wall.places, chosen);
  const CompactLevels levels(wall.places, chosen, {});
  EXPECT_GE(static_cast<double>(estimate.resident), 0.98 * static_cast<double>(levels.bytes()));
  EXPECT_LE(static_cast<double>(estimate.resident), 1.7 * static_cast<double>(levels.bytes()));
  EXPECT_GE(estimate.peak, estimate.resident);
}

}  // namespace
}  // namespace deform::compact_levels_test
