// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/triangle_tree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::triangle_tree_test {
namespace {

using Corners = std::array<PointId, 3>;
constexpr double infinity = std::numeric_limits<double>::infinity();

struct Soup {
  Points points;
  std::vector<Corners> triangles;
};

Soup soup(std::size_t count, double size, unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  Soup made;
  for (std::size_t t = 0; t < count; ++t) {
    const Vec3 at{uniform(random), uniform(random), uniform(random)};
    for (int i = 0; i < 3; ++i) made.points.push_back(at + size * Vec3{uniform(random), uniform(random), uniform(random)});
    const auto first = static_cast<PointId>(3 * t);
    made.triangles.push_back({first, first + 1, first + 2});
  }
  return made;
}

/// The least squared distance by the descent along the two parameters of the triangle, each to its exact minimum.
double distance_by_descent(const std::array<Vec3, 3>& corners, const Vec3& x) {
  double best = infinity;
  for (std::size_t first = 0; first < 3; ++first) {
    const Vec3 a = corners[first], u = corners[(first + 1) % 3] - a, v = corners[(first + 2) % 3] - a;
    double s = 0, t = 0;
    for (int i = 0; i < 2000; ++i) {
      s = std::clamp(dot(x - a - t * v, u) / dot(u, u), 0.0, 1 - t);
      t = std::clamp(dot(x - a - s * u, v) / dot(v, v), 0.0, 1 - s);
      const Vec3 w = v - u;  // along the third edge
      const double move = std::clamp(dot(x - a - s * u - t * v, w) / dot(w, w), -t, s);
      s -= move;
      t += move;
    }
    best = std::min(best, squared_distance(a + s * u + t * v, x));
  }
  return best;
}

std::array<Vec3, 3> corners_of(const Soup& made, std::size_t t) {
  return {made.points[made.triangles[t][0]], made.points[made.triangles[t][1]], made.points[made.triangles[t][2]]};
}

Vec3 weighted(const std::array<Vec3, 3>& corners, const PlaceOnTriangle& place) {
  return place.weights[0] * corners[0] + place.weights[1] * corners[1] + place.weights[2] * corners[2];
}

TEST(TriangleTree, NearestOnOneTriangleIsThatOfADescent) {
  const Soup made = soup(30, 1, 3);
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-1, 2);
  for (std::size_t t = 0; t < made.triangles.size(); ++t) {
    const auto corners = corners_of(made, t);
    for (int i = 0; i < 10; ++i) {
      const Vec3 x{uniform(random), uniform(random), uniform(random)};
      const PlaceOnTriangle place = nearest_on_triangle(corners, x);
      EXPECT_NEAR(std::sqrt(place.distance), std::sqrt(distance_by_descent(corners, x)), 1e-7);
      EXPECT_LT(distance(weighted(corners, place), place.point), 1e-14);
      for (const double weight : place.weights) EXPECT_TRUE(weight >= 0 && weight <= 1);
    }
  }
}

TEST(TriangleTree, NearestOfDegenerateTriangles) {
  const Vec3 a{1, 2, 3}, b{2, 2, 3};
  EXPECT_EQ(nearest_on_triangle({a, a, a}, {1, 2, 5}).distance, 4);
  EXPECT_EQ(nearest_on_triangle({a, b, a}, {1.5, 2, 5}).distance, 4);
  EXPECT_EQ(nearest_on_triangle({a, {1.25, 2, 3}, b}, {3, 2, 3}).distance, 1);
}

TEST(TriangleTree, NearestIsThatOfAllTriangles) {
  for (const std::size_t count : {1U, 4U, 5U, 300U}) {
    const Soup made = soup(count, 0.2, 7);
    const TriangleTree tree(made.triangles, made.points);
    std::mt19937_64 random(9);
    std::uniform_real_distribution<double> uniform(-0.5, 1.5);
    for (int i = 0; i < 200; ++i) {
      const Vec3 x{uniform(random), uniform(random), uniform(random)};
      const auto accept = [&](std::uint32_t t) { return count == 1 || t % 3 != static_cast<std::uint32_t>(i % 3); };
      double least = infinity;
      std::uint32_t expected = PlaceOnTriangle::none;
      for (std::uint32_t t = 0; t < count; ++t) {
        const double distance = nearest_on_triangle(corners_of(made, t), x).distance;
        if (accept(t) && distance < least) {
          least = distance;
          expected = t;
        }
      }
      const PlaceOnTriangle place = tree.nearest(x, infinity, accept);
      EXPECT_EQ(place.triangle, expected);
      EXPECT_EQ(place.distance, least);
      EXPECT_FALSE(tree.nearest(x, least, accept).found());
      EXPECT_TRUE(tree.nearest(x, least * (1 + 1e-12), accept).found());
    }
  }
}

/// Cramer's rule in long double; infinite where the ray passes by.
double along(const std::array<Vec3, 3>& corners, const Vec3& x, const Vec3& d) {
  const auto determinant = [](const Vec3& a, const Vec3& b, const Vec3& c) {
    const auto l = [](double value) { return static_cast<long double>(value); };
    return l(a[0]) * (l(b[1]) * c[2] - l(b[2]) * c[1]) - l(a[1]) * (l(b[0]) * c[2] - l(b[2]) * c[0]) +
           l(a[2]) * (l(b[0]) * c[1] - l(b[1]) * c[0]);
  };
  const Vec3 u = corners[1] - corners[0], v = corners[2] - corners[0], w = x - corners[0], back = -1.0 * d;
  const long double whole = determinant(u, v, back), s = determinant(w, v, back) / whole, t = determinant(u, w, back) / whole,
                    at = determinant(u, v, w) / whole;
  return s >= 0 && t >= 0 && s + t <= 1 && at >= 0 ? static_cast<double>(at) : infinity;
}

TEST(TriangleTree, FirstIsThatOfAllTriangles) {
  const Soup made = soup(400, 0.2, 11);
  const TriangleTree tree(made.triangles, made.points);
  std::mt19937_64 random(13);
  std::uniform_real_distribution<double> uniform(-1, 1);
  int found = 0;
  for (int i = 0; i < 1000; ++i) {
    const Vec3 x{0.5 + uniform(random), 0.5 + uniform(random), 0.5 + uniform(random)};
    Vec3 d{uniform(random), uniform(random), uniform(random)};
    if (i % 4 == 0) d[static_cast<std::size_t>(i / 4 % 3)] = 0;
    if (i % 8 == 0) d[static_cast<std::size_t>((i / 8 + 1) % 3)] = 0;
    if (length(d) == 0) continue;
    const auto accept = [&](std::uint32_t t) { return t % 5 != static_cast<std::uint32_t>(i % 5); };
    double least = infinity;
    for (std::uint32_t t = 0; t < made.triangles.size(); ++t) {
      if (accept(t)) least = std::min(least, along(corners_of(made, t), x, d));
    }
    const PlaceOnTriangle place = tree.first(Ray(x, d), accept);
    EXPECT_EQ(place.found(), std::isfinite(least));
    if (!place.found()) continue;
    ++found;
    EXPECT_NEAR(place.distance, least, 1e-12 * (1 + least));
    EXPECT_LT(distance(place.point, x + least * d), 1e-12);
    EXPECT_LT(distance(weighted(corners_of(made, place.triangle), place), place.point), 1e-12);
  }
  EXPECT_GT(found, 100);
}

TEST(TriangleTree, RaysThroughEdgesAndCornersOfAClosedSurfaceDoNotPass) {
  const Mesh mesh = test::sphere(1, 4);
  std::vector<Corners> triangles;
  for (std::size_t t = 0; t < mesh.face_count(); ++t) {
    triangles.push_back({mesh.face_points[3 * t], mesh.face_points[3 * t + 1], mesh.face_points[3 * t + 2]});
  }
  std::mt19937_64 random(17);
  std::uniform_real_distribution<double> uniform(-0.3, 0.3);
  for (int i = 0; i < 8; ++i) {
    const Vec3 shift{1000 * uniform(random), uniform(random), uniform(random)};
    Points points = mesh.points;
    for (Vec3& p : points) p = 0.001 * p + shift;
    const TriangleTree tree(triangles, points);
    const Vec3 x = shift + 0.001 * Vec3{uniform(random), uniform(random), uniform(random)};
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      const Vec3 &a = points[triangles[t][0]], &b = points[triangles[t][1]];
      for (const double share : {0.0, 0.25, 0.5, uniform(random) + 0.3}) {
        EXPECT_TRUE(tree.first(Ray(x, lerp(a, b, share) - x), [](std::uint32_t) { return true; }).found());
      }
    }
  }
}

TEST(TriangleTree, MovedIsThatOfTheNewPlaces) {
  const Soup made = soup(200, 0.2, 19);
  const TriangleTree tree(made.triangles, made.points);
  std::mt19937_64 random(23);
  std::uniform_real_distribution<double> uniform(-1, 1);
  Points points = made.points;
  for (Vec3& p : points) p = p + 0.3 * Vec3{uniform(random), uniform(random), uniform(random)};
  const TriangleTree moved = tree.moved(points, RunContext{}), anew(made.triangles, points);
  const auto all = [](std::uint32_t) { return true; };
  for (int i = 0; i < 300; ++i) {
    const Vec3 x{uniform(random), uniform(random), uniform(random)}, d{uniform(random), uniform(random), uniform(random)};
    EXPECT_EQ(moved.nearest(x, infinity, all).triangle, anew.nearest(x, infinity, all).triangle);
    EXPECT_EQ(moved.first(Ray(x, d), all).triangle, anew.first(Ray(x, d), all).triangle);
  }
}

TEST(TriangleTree, MovedFarAwayIsWhereThePointsAre) {
  // More triangles than one task moves.
  const Soup made = soup(17000, 0.01, 31);
  Points points = made.points;
  for (Vec3& p : points) p = p + Vec3{100, 0, 0};
  const TriangleTree moved = TriangleTree(made.triangles, made.points).moved(points, RunContext{});
  for (std::uint32_t t = 0; t < made.triangles.size(); t += 4000) {
    const Vec3& corner = points[made.triangles[t][1]];
    EXPECT_EQ(moved.nearest(corner, infinity, [&](std::uint32_t s) { return s == t; }).distance, 0);
    EXPECT_EQ(moved.nearest(corner, infinity, [](std::uint32_t) { return true; }).distance, 0);
  }
}

Box box_of(const std::array<Vec3, 3>& corners) {
  Box box;
  for (const Vec3& corner : corners) box.add(corner);
  return box;
}

bool apart(const Box& a, const Box& b) {
  for (std::size_t k = 0; k < 3; ++k) {
    if (a.max[k] < b.min[k] || b.max[k] < a.min[k]) return true;
  }
  return false;
}

TEST(TriangleTree, MeetingIsAllWhoseBoxesDo) {
  for (const std::size_t count : {1U, 4U, 5U, 9U, 300U}) {
    const Soup made = soup(count, 0.2, 37);
    Points places = made.points;
    for (Vec3& p : places) p = Vec3{p[1], 1 - p[0], p[2]};
    const TriangleTree tree(made.triangles, made.points), moved = tree.moved(places, RunContext{});
    std::mt19937_64 random(41);
    std::uniform_real_distribution<double> uniform(-0.3, 1.3), size(0, 0.5);
    for (int i = 0; i < 200; ++i) {
      Box box;
      box.add({uniform(random), uniform(random), uniform(random)});
      if (i % 5 != 0) box.add(box.min + Vec3{size(random), size(random), size(random)});
      // Boxes that only touch one of a triangle count.
      if (i % 7 == 0) box = box_of(corners_of(made, static_cast<std::size_t>(i) % count));
      for (const TriangleTree* asked : {&tree, &moved}) {
        const Soup there{asked == &tree ? made.points : places, made.triangles};
        std::vector<std::uint32_t> expected, found;
        for (std::uint32_t t = 0; t < count; ++t) {
          if (!apart(box_of(corners_of(there, t)), box)) expected.push_back(t);
        }
        asked->meeting(box, [&](std::uint32_t t) {
          found.push_back(t);
          return true;
        });
        std::sort(found.begin(), found.end());
        ASSERT_EQ(found, expected) << count << " " << i;
      }
    }
  }
}

TEST(TriangleTree, MeetingCountsBoxesThatTouch) {
  const Points points{{0, 0, 0}, {1, 0, 0}, {0, 1, 1}};
  const TriangleTree tree(std::vector<Corners>{{0, 1, 2}}, points);
  for (std::size_t k = 0; k < 3; ++k) {
    for (const double side : {0.0, 1.0}) {
      Vec3 touching{0.5, 0.5, 0.5};
      touching[k] = side;
      Vec3 beside = touching;
      beside[k] = side == 0 ? -1e-300 : 1 + 1e-15;
      for (const Vec3& x : {touching, beside}) {
        int visits = 0;
        tree.meeting(Box{x, x}, [&](std::uint32_t) {
          ++visits;
          return true;
        });
        EXPECT_EQ(visits, x == touching ? 1 : 0) << k << " " << side;
      }
    }
  }
}

TEST(TriangleTree, MeetingEndsWhenItIsToldTo) {
  const Soup made = soup(100, 0.2, 43);
  const TriangleTree tree(made.triangles, made.points);
  for (const int most : {1, 2, 50}) {
    int visits = 0;
    tree.meeting(bounding_box(made.points), [&](std::uint32_t) { return ++visits < most; });
    EXPECT_EQ(visits, most);
  }
}

TEST(TriangleTree, OfEquallyCloseTrianglesTheFirstCounts) {
  // The same triangle many times, in an order in which the tree does not hold them.
  Soup made = soup(1, 1, 47);
  for (int i = 0; i < 40; ++i) made.triangles.push_back(made.triangles[0]);
  const TriangleTree tree(made.triangles, made.points);
  const std::array<Vec3, 3> corners = corners_of(made, 0);
  const Vec3 middle = (corners[0] + corners[1] + corners[2]) / 3.0, x = middle + Vec3{3, 2, 1};
  for (std::uint32_t first = 0; first <= 40; ++first) {
    const auto accept = [&](std::uint32_t t) { return t >= first; };
    EXPECT_EQ(tree.nearest(x, infinity, accept).triangle, first);
    EXPECT_EQ(tree.first(Ray(x, middle - x), accept).triangle, first);
  }
}

TEST(TriangleTree, ConesPassOverNothingThatIsAsked) {
  // Facets of a ball, some of which have no normal, in all directions.
  const Mesh mesh = test::sphere(1, 4);
  std::vector<Corners> triangles;
  Points normals;
  for (std::size_t t = 0; t < mesh.face_count(); ++t) {
    triangles.push_back({mesh.face_points[3 * t], mesh.face_points[3 * t + 1], mesh.face_points[3 * t + 2]});
    const Vec3& a = mesh.points[triangles[t][0]];
    const Vec3 normal = cross(mesh.points[triangles[t][1]] - a, mesh.points[triangles[t][2]] - a);
    normals.push_back(t % 50 == 0 ? Vec3{} : normal / length(normal));
  }
  const TriangleTree tree(triangles, mesh.points);
  std::mt19937_64 random(29);
  std::normal_distribution<double> normal(0, 1);
  for (const double degrees : {0.5, 30.0, 60.0, 90.0}) {
    const double least = std::cos(degrees * std::numbers::pi / 180);
    const NormalCones cones = tree.cones(normals, least, RunContext{});
    std::size_t all = 0, asked = 0;
    for (std::size_t i = 0; i < 300; ++i) {
      Vec3 u{normal(random), normal(random), normal(random)};
      u = i % 3 == 0 ? normals[7 * i % normals.size()] : u / length(u);
      if (length(u) == 0) continue;
      const Vec3 x{normal(random), normal(random), normal(random)};
      const auto accept = [&](std::uint32_t t) {
        ++all;
        return dot(u, normals[t]) >= least;
      };
      const auto counted = [&](std::uint32_t t) {
        ++asked;
        return dot(u, normals[t]) >= least;
      };
      const PlaceOnTriangle expected = tree.nearest(x, infinity, accept);
      const PlaceOnTriangle found =
          tree.nearest(x, infinity, counted, [&](std::uint32_t node) { return cones.may_hold(node, u); });
      ASSERT_EQ(found.triangle, expected.triangle);
      ASSERT_EQ(found.distance, expected.distance);
    }
    EXPECT_LT(asked, all);
  }
}

TEST(TriangleTree, WithoutTriangles) {
  const TriangleTree tree(std::vector<Corners>{}, Points{});
  EXPECT_FALSE(tree.nearest({0, 0, 0}, infinity, [](std::uint32_t) { return true; }).found());
  tree.meeting(Box{{-1, -1, -1}, {1, 1, 1}}, [](std::uint32_t) {
    ADD_FAILURE() << "there is none";
    return true;
  });
  EXPECT_FALSE(tree.moved(Points{}, RunContext{}).first(Ray({0, 0, 0}, {1, 0, 0}), [](std::uint32_t) { return true; }).found());
}

TEST(TriangleTree, MakingOneOfManyTrianglesCanBeStopped) {
  std::stop_source stop;
  RunContext context;
  context.stop = stop.get_token();
  stop.request_stop();
  const Soup made = soup(5000, 0.1, 3);
  test::expect_error(ErrorCode::cancelled, {}, [&] { TriangleTree(made.triangles, made.points, context); });
}

}  // namespace
}  // namespace deform::triangle_tree_test
