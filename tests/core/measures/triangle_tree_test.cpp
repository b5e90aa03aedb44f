// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/triangle_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "tests/core/measures/measure_checks.h"
#include "tests/core/quality/surface_meshes.h"

namespace deform::measures {
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
  const Soup made = soup(60, 1, 3);
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
  for (int i = 0; i < 20; ++i) {
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
  const Points points = test::shaken(made.points, 0.3, 3);
  const TriangleTree moved = tree.moved(points, RunContext{}), anew(made.triangles, points);
  std::mt19937_64 random(23);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto all = [](std::uint32_t) { return true; };
  for (int i = 0; i < 300; ++i) {
    const Vec3 x{uniform(random), uniform(random), uniform(random)}, d{uniform(random), uniform(random), uniform(random)};
    EXPECT_EQ(moved.nearest(x, infinity, all).triangle, anew.nearest(x, infinity, all).triangle);
    EXPECT_EQ(moved.first(Ray(x, d), all).triangle, anew.first(Ray(x, d), all).triangle);
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
  EXPECT_FALSE(tree.moved(Points{}, RunContext{}).first(Ray({0, 0, 0}, {1, 0, 0}), [](std::uint32_t) { return true; }).found());
}

}  // namespace
}  // namespace deform::measures
