// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/triangle_pairs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include "core/base/vectors.h"
#include "core/mesh/exact_signs.h"

namespace deform::triangle_pairs_test {
namespace {

using Whole = std::array<std::int64_t, 3>;

Whole operator-(const Whole& a, const Whole& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Whole cross(const Whole& a, const Whole& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
std::int64_t dot(const Whole& a, const Whole& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
bool is_zero(const Whole& a) { return a == Whole{}; }

/// Whether the convex hulls of two sets have no point in common: by all directions that may part two polygons or segments in
/// space, the normals and the cross products of edges with edges and normals. In whole numbers.
bool apart(const std::vector<Whole>& a, const std::vector<Whole>& b) {
  std::vector<Whole> edges, ways;
  for (const auto* hull : {&a, &b}) {
    for (std::size_t i = 0; i < hull->size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) edges.push_back((*hull)[i] - (*hull)[j]);
    }
  }
  for (const Whole& e : edges) {
    for (const Whole& f : edges) {
      const Whole normal = cross(e, f);
      ways.push_back(normal);
      if (is_zero(normal)) continue;
      for (const Whole& g : edges) ways.push_back(cross(normal, g));
    }
    ways.push_back(e);
  }
  for (const Whole& way : ways) {
    if (is_zero(way)) continue;
    const auto range = [&](const std::vector<Whole>& hull) {
      std::int64_t least = dot(hull[0], way), most = least;
      for (const Whole& p : hull) {
        least = std::min(least, dot(p, way));
        most = std::max(most, dot(p, way));
      }
      return std::pair(least, most);
    };
    const auto [least_a, most_a] = range(a);
    const auto [least_b, most_b] = range(b);
    if (most_a < least_b || most_b < least_a) return true;
  }
  return false;
}

std::vector<Whole> without(const std::vector<Whole>& hull, const Whole& corner) {
  std::vector<Whole> rest;
  std::copy_if(hull.begin(), hull.end(), std::back_inserter(rest), [&](const Whole& p) { return p != corner; });
  return rest;
}

bool expected(const std::vector<Whole>& a, const std::vector<Whole>& b) {
  std::vector<Whole> shared;
  std::copy_if(a.begin(), a.end(), std::back_inserter(shared),
               [&](const Whole& p) { return std::count(b.begin(), b.end(), p) > 0; });
  if (shared.size() == 3) return true;
  if (shared.empty()) return !apart(a, b);
  if (shared.size() == 1) return !apart(without(a, shared[0]), b) || !apart(without(b, shared[0]), a);
  // A common side: on the same side of it, in the same direction from it.
  Whole apex_a{}, apex_b{};
  for (const Whole& p : a) {
    if (std::count(shared.begin(), shared.end(), p) == 0) apex_a = p;
  }
  for (const Whole& p : b) {
    if (std::count(shared.begin(), shared.end(), p) == 0) apex_b = p;
  }
  const Whole side = shared[1] - shared[0], n = cross(side, apex_a - shared[0]), m = cross(side, apex_b - shared[0]);
  return is_zero(cross(n, m)) && dot(n, m) > 0;
}

/// A number for each place, below 400 in each coordinate, either sign.
PointId place(const Whole& p) { return static_cast<PointId>(((p[0] + 400) * 1000 + p[1] + 400) * 1000 + p[2] + 400); }

TriangleCorners corners_of(const std::vector<Whole>& hull, double size, const Vec3& shift) {
  TriangleCorners corners;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k) corners[i][k] = size * static_cast<double>(hull[i][k]) + shift[k];
  }
  return corners;
}

SurfaceTriangle placed(const std::vector<Whole>& hull, double size, const Vec3& shift,
                       std::array<std::size_t, 3> order = {0, 1, 2}) {
  const std::vector<Whole> turned{hull[order[0]], hull[order[1]], hull[order[2]]};
  return {{place(turned[0]), place(turned[1]), place(turned[2])}, corners_of(turned, size, shift)};
}

/// Random triangles with corners on a grid of so few points that they often share, touch and lie in one plane.
struct Pairs {
  std::mt19937_64 random;
  std::int64_t most;

  std::vector<Whole> triangle() {
    std::uniform_int_distribution<std::int64_t> uniform(0, most);
    for (;;) {
      std::vector<Whole> made;
      for (int i = 0; i < 3; ++i) made.push_back({uniform(random), uniform(random), uniform(random)});
      if (!is_zero(cross(made[1] - made[0], made[2] - made[0]))) return made;
    }
  }
};

TEST(TrianglePairs, MatchSeparatingDirectionsInWholeNumbers) {
  std::array<int, 4> yes{}, no{};
  for (const std::int64_t most : {1, 2, 3, 6, 20}) {
    Pairs pairs{std::mt19937_64(7 + static_cast<unsigned>(most)), most};
    for (int i = 0; i < 3000; ++i) {
      const auto a = pairs.triangle(), b = pairs.triangle();
      const bool answer = expected(a, b);
      const auto shared =
          std::count_if(a.begin(), a.end(), [&](const Whole& p) { return std::count(b.begin(), b.end(), p) > 0; });
      ++(answer ? yes : no)[static_cast<std::size_t>(shared)];
      // Halves and thousands of a unit, and far from the origin, where products of coordinates are not exact.
      for (const double size : {1.0, 0.125, 1024.0}) {
        const Vec3 far{3e9, -7e9, 5e9};
        const SurfaceTriangle s = placed(a, size, far), t = placed(b, size, far);
        ASSERT_EQ(intersect(s, t), answer) << i << " of " << most << " at " << size;
        ASSERT_EQ(intersect(t, s), answer);
        ASSERT_EQ(intersect(placed(a, size, far, {2, 1, 0}), placed(b, size, far, {1, 2, 0})), answer);
      }
    }
  }
  for (int shared = 0; shared < 3; ++shared) {
    EXPECT_GT(yes[static_cast<std::size_t>(shared)], 20) << shared;
    EXPECT_GT(no[static_cast<std::size_t>(shared)], 20) << shared;
  }
}

TEST(TrianglePairs, AreFoundInEveryPlane) {
  // Turned by matrices of whole numbers: touching and overlapping triangles in planes that no coordinate axis spans.
  const std::array<Whole, 3> turn{{{2, 3, 6}, {3, -6, 2}, {6, 2, -3}}};  // 7 times a rotation
  Pairs pairs{std::mt19937_64(3), 4};
  int yes = 0;
  for (int i = 0; i < 3000; ++i) {
    std::array<std::vector<Whole>, 2> both{pairs.triangle(), pairs.triangle()};
    for (auto& hull : both) {
      for (Whole& p : hull) {
        p[2] = 0;
        p = {dot(turn[0], p), dot(turn[1], p), dot(turn[2], p)};
      }
    }
    if (has_no_area(corners_of(both[0], 0.25, {})) || has_no_area(corners_of(both[1], 0.25, {}))) continue;
    const bool answer = expected(both[0], both[1]);
    yes += answer;
    ASSERT_EQ(intersect(placed(both[0], 0.25, {}), placed(both[1], 0.25, {})), answer) << i;
  }
  EXPECT_GT(yes, 500);
}

TEST(TrianglePairs, OneUlpParts) {
  const SurfaceTriangle floor{{0, 1, 2}, {{{0, 0, 0.1}, {1, 0, 0.1}, {0, 1, 0.1}}}};
  const auto above = [](double z) { return SurfaceTriangle{{3, 4, 5}, {{{0.2, 0.2, z}, {0.3, 0.2, 1}, {0.2, 0.3, 1}}}}; };
  EXPECT_TRUE(intersect(floor, above(0.1)));
  EXPECT_FALSE(intersect(floor, above(std::nextafter(0.1, 1))));
  EXPECT_TRUE(intersect(floor, above(std::nextafter(0.1, 0))));
}

TEST(TrianglePairs, ShareWhatIsOnePlaceAndStaysTogether) {
  // Two triangles with a common side, at an angle.
  const TriangleCorners floor{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}, wall{{{0, 0, 0}, {1, 0, 0}, {0, 0, 1}}};
  EXPECT_FALSE(intersect({{0, 1, 2}, floor}, {{0, 1, 3}, wall}));
  EXPECT_TRUE(intersect({{0, 1, 2}, floor}, {{4, 5, 3}, wall})) << "others that came to the same place touch";
  EXPECT_TRUE(intersect({{0, 1, 2}, floor}, {{0, 5, 3}, wall}));
  const TriangleCorners parted{{{0.1, 0.1, 0}, {0.2, 0.1, 0}, {0, 0, 1}}};
  EXPECT_TRUE(intersect({{0, 1, 2}, floor}, {{0, 1, 3}, parted})) << "they were one place, but stand apart";
}

TEST(ExactSigns, AreThoseOfWholeNumbers) {
  std::mt19937_64 random(5);
  std::uniform_int_distribution<std::int64_t> uniform(-(1 << 20), 1 << 20);
  std::uniform_int_distribution<std::int64_t> few(-2, 2);
  int zero = 0;
  for (int i = 0; i < 20000; ++i) {
    std::array<Whole, 4> p;
    for (auto& q : p) q = {uniform(random), uniform(random), uniform(random)};
    // d close to the plane of the others: a + s (b - a) + t (c - a), off by at most a unit or two.
    const std::int64_t s = few(random), t = few(random);
    for (std::size_t k = 0; k < 3; ++k) {
      p[3][k] = p[0][k] + s * (p[1][k] - p[0][k]) + t * (p[2][k] - p[0][k]) + (i % 2 == 0 ? 0 : few(random));
    }
    std::array<Vec3, 4> x;
    for (std::size_t c = 0; c < 4; ++c) {
      // A shift that all coordinates take exactly, but not the products of their differences with it.
      for (std::size_t k = 0; k < 3; ++k) x[c][k] = static_cast<double>(p[c][k]) / 8 + 1e8;
    }
    const std::int64_t volume = dot(cross(p[1] - p[0], p[2] - p[0]), p[3] - p[0]);
    const int sign = volume > 0 ? 1 : volume < 0 ? -1 : 0;
    zero += sign == 0;
    ASSERT_EQ(side_of_plane(x[0], x[1], x[2], x[3]), -sign) << i;
    const int clear = clear_side_of_plane(x[0], x[1], x[2], x[3]);
    ASSERT_TRUE(clear == 0 || clear == -sign);
    for (int axis = 0; axis < 3; ++axis) {
      const std::int64_t area = cross(p[1] - p[0], p[3] - p[0])[static_cast<std::size_t>(axis)];
      const int turn = area > 0 ? 1 : area < 0 ? -1 : 0;
      ASSERT_EQ(side_of_line(x[0], x[1], x[3], axis), turn);
      const int clear_turn = clear_side_of_line(x[0], x[1], x[3], axis);
      ASSERT_TRUE(clear_turn == 0 || clear_turn == turn);
    }
  }
  EXPECT_GT(zero, 5000);
}

TEST(ExactSigns, TellWhatRoundingHides) {
  // On and beside a line through points whose coordinates are no multiples of each other: 0.1, 0.2 and 0.3 are not on it.
  const Vec3 a{0.1, 0.1, 0}, b{0.2, 0.2, 0}, c{0.3, 0.3, 0}, d{0.3, std::nextafter(0.3, 1), 0};
  EXPECT_EQ(side_of_line(a, b, c, 2), 0);
  EXPECT_EQ(side_of_line(a, b, d, 2), 1);
  // The plane z = x / 3 has no three such points but where z is exact.
  const Vec3 p{0, 0, 0}, q{3, 0, 1}, r{0, 1, 0};
  EXPECT_EQ(side_of_plane(p, q, r, {1, 7, 1.0 / 3}), 1 - 2 * (1.0 / 3 * 3 < 1));
  EXPECT_EQ(side_of_plane(p, q, r, {6, 1e-300, 2}), 0);
}

}  // namespace
}  // namespace deform::triangle_pairs_test
