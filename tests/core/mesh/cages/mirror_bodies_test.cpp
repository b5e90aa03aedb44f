// SPDX-License-Identifier: GPL-3.0-or-later
// Bodies whose mirror planes are known in closed form, turned at random and meshed without regard to their symmetry. Most have
// principal moments that are the same, so that these tell no direction.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/mesh/cages/mirror_search.h"
#include "tests/support/long_tests.h"

namespace deform::mirror_bodies_test {
namespace {

using Random = std::mt19937_64;
using Triangles = std::vector<TriangleCorners>;
constexpr double pi = std::numbers::pi;

double within(Random& random, double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); }

/// A convex polygon as a fan.
void add(Triangles& triangles, const std::vector<Vec3>& polygon) {
  for (std::size_t i = 2; i < polygon.size(); ++i) triangles.push_back({polygon[0], polygon[i - 1], polygon[i]});
}

/// The solid between two polygons with as many corners, the first below.
void add_between(Triangles& triangles, std::vector<Vec3> below, const std::vector<Vec3>& above) {
  for (std::size_t i = 0; i < below.size(); ++i) {
    const std::size_t j = (i + 1) % below.size();
    add(triangles, {below[i], below[j], above[j], above[i]});
  }
  add(triangles, above);
  std::reverse(below.begin(), below.end());
  add(triangles, below);
}

std::vector<Vec3> raised(std::vector<Vec3> polygon, double z) {
  for (Vec3& x : polygon) x[2] = z;
  return polygon;
}

Vec3 about_z(const Vec3& x, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * x[0] - s * x[1], s * x[0] + c * x[1], x[2]};
}

Triangles box(const Vec3& sides) {
  const double a = sides[0] / 2, b = sides[1] / 2, c = sides[2] / 2;
  const std::vector<Vec3> around{{-a, -b, 0}, {a, -b, 0}, {a, b, 0}, {-a, b, 0}};
  Triangles triangles;
  add_between(triangles, raised(around, -c), raised(around, c));
  return triangles;
}

/// Corners on the unit circle, the first at angle 0.
std::vector<Vec3> regular(unsigned n) {
  std::vector<Vec3> corners;
  for (unsigned i = 0; i < n; ++i) corners.push_back(about_z({1, 0, 0}, 2 * pi * i / n));
  return corners;
}

Triangles prism(unsigned n, double height) {
  Triangles triangles;
  add_between(triangles, raised(regular(n), -height / 2), raised(regular(n), height / 2));
  return triangles;
}

/// Uneven corners on the unit circle.
std::vector<Vec3> uneven_circle(Random& random) {
  constexpr unsigned n = 160;
  std::vector<Vec3> corners;
  for (unsigned i = 0; i < n; ++i) corners.push_back(about_z({1, 0, 0}, 2 * pi * (i + within(random, -0.4, 0.4)) / n));
  return corners;
}

Triangles cylinder(Random& random, double height) {
  Triangles triangles;
  const std::vector<Vec3> around = uneven_circle(random);
  add_between(triangles, raised(around, -height / 2), raised(around, height / 2));
  return triangles;
}

/// A rim and `n` spokes, of which `wide` have twice the width of the others.
Triangles wheel(Random& random, unsigned n, unsigned wide = 0) {
  Triangles triangles;
  std::vector<Vec3> outside = uneven_circle(random), inside = uneven_circle(random);
  for (Vec3& x : inside) x = 0.9 * x;
  for (const auto& ring : {outside, inside}) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const Vec3 up{0, 0, 0.1}, &a = ring[i], &b = ring[(i + 1) % ring.size()];
      add(triangles, {a - up, b - up, b + up, a + up});
    }
  }
  const double width = 0.3 / n;
  for (unsigned i = 0; i < n; ++i) {
    const double w = (wide > 0 && i % (n / wide) == 0 ? 2 : 1) * width;
    std::vector<Vec3> around{{0.15, -w, 0}, {0.9, -w, 0}, {0.9, w, 0}, {0.15, w, 0}};
    for (Vec3& x : around) x = about_z(x, 2 * pi * i / n);
    add_between(triangles, raised(around, -0.06), raised(around, 0.06));
  }
  return triangles;
}

/// The faces of the convex hull of a few points, by trying all triples.
Triangles hull_of(const std::vector<Vec3>& corners) {
  Triangles triangles;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    for (std::size_t j = i + 1; j < corners.size(); ++j) {
      for (std::size_t k = j + 1; k < corners.size(); ++k) {
        const Vec3 n = cross(corners[j] - corners[i], corners[k] - corners[i]);
        std::vector<Vec3> face;
        bool below = true, above = true;
        for (const Vec3& x : corners) {
          const double height = dot(n, x - corners[i]) / norm(n);
          below = below && height < 1e-9;
          above = above && height > -1e-9;
          if (std::abs(height) < 1e-9) face.push_back(x);
        }
        if (!below && !above) continue;
        // Each face once, by its first three corners.
        if (face[0] != corners[i] || face[1] != corners[j] || face[2] != corners[k]) continue;
        Vec3 middle{};
        for (const Vec3& x : face) middle = middle + x / static_cast<double>(face.size());
        const Vec3 u = face[0] - middle, v = cross(n, u) / norm(n);
        std::sort(face.begin(), face.end(), [&](const Vec3& a, const Vec3& b) {
          return std::atan2(dot(v, a - middle), dot(u, a - middle)) < std::atan2(dot(v, b - middle), dot(u, b - middle));
        });
        add(triangles, face);
      }
    }
  }
  return triangles;
}

/// All permutations of the coordinates that are of the given parity, with all signs of which the product has a sign, 0: either.
std::vector<Vec3> orbit(const Vec3& x, bool odd, int sign) {
  std::vector<Vec3> places;
  for (unsigned turn = 0; turn < 3; ++turn) {
    for (unsigned signs = 0; signs < 8; ++signs) {
      const std::array<double, 3> s{(signs & 1U) != 0 ? -1.0 : 1.0, (signs & 2U) != 0 ? -1.0 : 1.0,
                                    (signs & 4U) != 0 ? -1.0 : 1.0};
      if (sign != 0 && s[0] * s[1] * s[2] != sign) continue;
      const Vec3 y = odd ? Vec3{x[1], x[0], x[2]} : x;
      Vec3 place{};
      for (std::size_t k = 0; k < 3; ++k) place[k] = s[k] * y[(k + turn) % 3];
      places.push_back(place);
    }
  }
  std::sort(places.begin(), places.end());
  places.erase(std::unique(places.begin(), places.end()), places.end());
  return places;
}

Triangles icosahedron() { return hull_of(orbit({0, 1, std::numbers::phi}, false, 0)); }

/// The snub cube: the rotations of a cube, but none of its mirror planes. Even permutations with an even number of minus signs,
/// odd ones with an odd number.
Triangles snub_cube() {
  constexpr double t = 1.83928675521416;
  std::vector<Vec3> corners = orbit({1, 1 / t, t}, false, 1);
  for (const Vec3& x : orbit({1, 1 / t, t}, true, -1)) corners.push_back(x);
  return hull_of(corners);
}

/// A tube around a helix of two turns.
Triangles helix() {
  Triangles triangles;
  constexpr unsigned along = 120, around = 8;
  const auto place = [](unsigned i, unsigned j) {
    const double a = 4 * pi * i / along, b = 2 * pi * j / around;
    const Vec3 out{std::cos(a), std::sin(a), 0};
    return (1 + 0.2 * std::cos(b)) * out + Vec3{0, 0, 0.3 * a + 0.2 * std::sin(b)};
  };
  for (unsigned i = 0; i < along; ++i) {
    for (unsigned j = 0; j < around; ++j) add(triangles, {place(i, j), place(i + 1, j), place(i + 1, j + 1), place(i, j + 1)});
  }
  return triangles;
}

/// Blades that are pitched about their long axes.
Triangles propeller(unsigned blades, double pitch) {
  Triangles triangles;
  for (unsigned i = 0; i < blades; ++i) {
    for (TriangleCorners t : box({0.8, 0.25, 0.04})) {
      for (Vec3& x : t) {
        const double c = std::cos(pitch), s = std::sin(pitch);
        x = about_z({x[0] + 0.55, c * x[1] - s * x[2], s * x[1] + c * x[2]}, 2 * pi * i / blades);
      }
      triangles.push_back(t);
    }
  }
  return triangles;
}

/// A saw blade whose upper side is smaller than the lower one: n turns take it to itself and nothing else does.
Triangles cone_of_teeth(unsigned n) {
  std::vector<Vec3> below, above;
  for (unsigned i = 0; i < n; ++i) {
    below.push_back(about_z({1, 0, 0}, 2 * pi * i / n));
    below.push_back(about_z({0.6, 0, 0}, 2 * pi * (i + 0.1) / n));
  }
  for (const Vec3& x : below) above.push_back(0.6 * x + Vec3{0, 0, 0.5});
  Triangles triangles;
  for (std::size_t i = 0; i < below.size(); ++i) {
    const std::size_t j = (i + 1) % below.size();
    add(triangles, {below[i], below[j], above[j], above[i]});
    add(triangles, {{0, 0, 0}, below[j], below[i]});
    add(triangles, {{0, 0, 0.5}, above[i], above[j]});
  }
  return triangles;
}

/// Triangles with edges of up to `longest`, cut at random places: no corner inside of a face has an image.
Triangles meshed(Triangles triangles, double longest, Random& random) {
  for (std::size_t t = 0; t < triangles.size();) {
    const TriangleCorners corners = triangles[t];
    std::array<double, 3> edges{};
    for (std::size_t k = 0; k < 3; ++k) edges[k] = distance(corners[k], corners[(k + 1) % 3]);
    const auto k = static_cast<std::size_t>(std::max_element(edges.begin(), edges.end()) - edges.begin());
    if (edges[k] <= longest) {
      ++t;
      continue;
    }
    const Vec3 cut = lerp(corners[k], corners[(k + 1) % 3], within(random, 0.3, 0.7));
    triangles[t][(k + 1) % 3] = cut;
    triangles.push_back(corners);
    triangles.back()[k] = cut;
  }
  return triangles;
}

double diagonal_of(const Triangles& triangles) {
  Box box;
  for (const TriangleCorners& t : triangles) {
    for (const Vec3& x : t) box.add(x);
  }
  return box.diagonal();
}

/// A turn about any axis by any angle.
std::array<Vec3, 3> any_turn(Random& random) {
  std::normal_distribution<double> normal;
  Vec3 a{normal(random), normal(random), normal(random)}, b{normal(random), normal(random), normal(random)};
  a = a / norm(a);
  b = b - dot(a, b) * a;
  b = b / norm(b);
  return {a, b, cross(a, b)};
}

/// Where a body stands, and in which unit.
struct Place {
  std::array<Vec3, 3> turn{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  Vec3 moved{};
  double unit = 1;

  Vec3 direction(const Vec3& x) const { return x[0] * turn[0] + x[1] * turn[1] + x[2] * turn[2]; }
  Vec3 operator()(const Vec3& x) const { return unit * (direction(x) + moved); }
};

/// Remeshed, with noise of up to a part of D that is the same for corners at the same place, and put somewhere.
Triangles put(const Triangles& body, const Place& place, double noise, Random& random) {
  const double diagonal = diagonal_of(body);
  Triangles triangles = meshed(body, 0.09 * diagonal, random);
  std::map<Vec3, Vec3> noises;
  for (TriangleCorners& t : triangles) {
    for (Vec3& x : t) {
      Vec3& own = noises[x];
      if (noise > 0 && own == Vec3{}) {
        for (double& c : own) c = noise * diagonal * within(random, -1, 1);
      }
      x = place(x + own);
    }
  }
  return triangles;
}

struct Known {
  std::string name;
  Triangles body;
  std::vector<Vec3> normals;  ///< of all its planes, through the origin
  std::size_t orthogonal;     ///< the largest number that are orthogonal to each other
  double facets = 0;          ///< of D: how far the mesh is from its image because curved faces are in facets
};

/// Across z, and across directions in steps of half a turn over n, from an angle on.
std::vector<Vec3> around_z(unsigned n, double from = 0, bool flat = true) {
  std::vector<Vec3> normals;
  if (flat) normals.push_back({0, 0, 1});
  for (unsigned i = 0; i < n; ++i) normals.push_back(about_z({1, 0, 0}, from + pi * i / n));
  return normals;
}

std::vector<Vec3> of_a_cube() {
  std::vector<Vec3> normals = orbit({0, 0, 1}, false, 0);
  for (const Vec3& x : orbit({0, 1 / std::numbers::sqrt2, 1 / std::numbers::sqrt2}, false, 0)) normals.push_back(x);
  return normals;
}

/// Those that change corners of a regular body, through the middles of its edges.
std::vector<Vec3> of_an_icosahedron() {
  std::vector<Vec3> normals;
  const std::vector<Vec3> corners = orbit({0, 1, std::numbers::phi}, false, 0);
  for (const Vec3& a : corners) {
    for (const Vec3& b : corners) {
      if (std::abs(distance(a, b) - 2) < 1e-9) normals.push_back((a - b) / 2.0);
    }
  }
  return normals;
}

std::vector<Known> known_bodies() {
  Random random(17);
  std::vector<Known> bodies;
  bodies.push_back({"square plate", box({1, 1, 0.1}), around_z(4), 3});
  bodies.push_back({"square bar", box({1, 1, 4}), around_z(4), 3});
  bodies.push_back({"cube", box({1, 1, 1}), of_a_cube(), 3});
  bodies.push_back({"box", box({1, 1.3, 0.6}), around_z(2), 3});
  bodies.push_back(
      {"wedge", hull_of({{0, 1, 0}, {0, -1, 0}, {2, 1, 0}, {2, -1, 0}, {0.2, 1, 0.7}, {0.2, -1, 0.7}}), {{0, 1, 0}}, 1});
  for (const unsigned n : {3U, 5U, 6U, 8U, 9U}) {
    // Through the corners, so across the directions at right angles to them.
    bodies.push_back({"prism of " + std::to_string(n), prism(n, 0.7), around_z(n, pi / 2), n % 2 == 0 ? 3U : 2U});
  }
  for (const unsigned n : {3U, 4U, 5U, 6U, 7U, 12U, 36U, 60U}) {
    bodies.push_back({"wheel of " + std::to_string(n), wheel(random, n), around_z(n, pi / 2), n % 2 == 0 ? 3U : 2U, 3e-4});
  }
  for (const unsigned n : {12U, 36U}) {  // nearly symmetric to n planes more
    const std::string name = "wheel of " + std::to_string(n);
    bodies.push_back({name + " with a wide spoke", wheel(random, n, 1), {{0, 0, 1}, {0, 1, 0}}, 2, 3e-4});
    bodies.push_back({name + " with three wide spokes", wheel(random, n, 3), around_z(3, pi / 2), 2, 3e-4});
  }
  bodies.push_back({"tetrahedron", hull_of(orbit({1, 1, 1}, false, 1)),
                    orbit({0, 1 / std::numbers::sqrt2, 1 / std::numbers::sqrt2}, false, 0), 2});
  bodies.push_back({"octahedron", hull_of(orbit({0, 0, 1}, false, 0)), of_a_cube(), 3});
  bodies.push_back({"icosahedron", icosahedron(), of_an_icosahedron(), 3});
  return bodies;
}

TEST(MirrorBodies, HaveTheirPlanesInAnyPosition) {
  Random random(3);
  const int turns = test::long_tests() ? 2 : 1;
  for (const Known& known : known_bodies()) {
    const double diagonal = diagonal_of(known.body);
    for (const double noise : {0.0, 1e-4}) {
      for (int turn = 0; turn < turns; ++turn) {
        SCOPED_TRACE(known.name + ", noise " + std::to_string(noise) + ", turn " + std::to_string(turn));
        const Place place{any_turn(random),
                          {within(random, -3, 3), within(random, -3, 3), within(random, -3, 3)},
                          std::pow(10.0, static_cast<double>(random() % 3) * 3 - 3)};
        const Triangles triangles = put(known.body, place, noise, random);
        const SurfaceMirrors found = surface_mirrors(triangles, 8e-4 * diagonal * place.unit);
        EXPECT_EQ(found.planes.size(), known.orthogonal);
        const bool exact = noise == 0 && known.facets == 0;
        EXPECT_LE(found.deviation, (exact ? 1e-8 : known.facets + 4 * noise + 1e-4) * diagonal * place.unit);
        for (const CagePlane& plane : found.planes) {
          EXPECT_NEAR(norm(plane.normal), 1, 1e-12);
          double least = 1;
          for (const Vec3& normal : known.normals) least = std::min(least, norm(cross(plane.normal, place.direction(normal))));
          EXPECT_LE(least, exact ? 1e-7 : 2e-3);
          EXPECT_LE(std::abs(dot(plane.normal, plane.point - place({0, 0, 0}))), (exact ? 1e-8 : 5e-4) * diagonal * place.unit);
          for (const CagePlane& other : found.planes) {
            EXPECT_TRUE(&other == &plane || std::abs(dot(plane.normal, other.normal)) < 1e-12);
          }
        }
      }
    }
  }
}

// Every plane through the axis is one, and that across it.
TEST(MirrorBodies, OfRevolutionHaveThreePlanes) {
  Random random(4);
  for (const double height : {0.2, 1.5, 4.0}) {
    for (int turn = 0; turn < (test::long_tests() ? 2 : 1); ++turn) {
      const Place place{any_turn(random), {1, 2, 3}, height < 1 ? 1e3 : 1.0};
      const Triangles triangles = put(cylinder(random, height), place, 0, random);
      const SurfaceMirrors found = surface_mirrors(triangles, 8e-4 * diagonal_of(triangles));
      EXPECT_EQ(found.planes.size(), 3u) << height;
      const Vec3 axis = place.direction({0, 0, 1});
      for (const CagePlane& plane : found.planes) {
        const double along = std::abs(dot(plane.normal, axis));
        EXPECT_LT(std::min(along, 1 - along), 1e-3) << height;
      }
    }
  }
}

// Those across the shortest way through the body, whatever position it is in.
TEST(MirrorBodies, WithMorePlanesAreGivenThoseFromWhichTheyReachLeastFar) {
  Random random(5);
  for (const Vec3& sides : {Vec3{1, 1, 0.1}, Vec3{1, 1, 1}, Vec3{1, 1, 3}}) {
    for (int turn = 0; turn < 8; ++turn) {
      const Place place{any_turn(random), {}, 1};
      const SurfaceMirrors found = surface_mirrors(put(box(sides), place, 0, random), 1e-3);
      ASSERT_EQ(found.planes.size(), 3u);
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3 side = place.direction({k == 0 ? 1.0 : 0.0, k == 1 ? 1.0 : 0.0, k == 2 ? 1.0 : 0.0});
        EXPECT_TRUE(std::any_of(found.planes.begin(), found.planes.end(),
                                [&](const CagePlane& p) { return std::abs(dot(p.normal, side)) > 1 - 1e-12; }));
      }
    }
  }
  // But those across coordinate axes if they fit as well.
  Place place;
  const double s = std::sqrt(0.5);
  place.turn = {{{s, s, 0}, {-s, s, 0}, {0, 0, 1}}};
  const SurfaceMirrors found = surface_mirrors(put(box({1, 1, 0.1}), place, 0, random), 1e-3);
  ASSERT_EQ(found.planes.size(), 3u);
  for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(std::abs(found.planes[k].normal[k]), 1);
}

TEST(MirrorBodies, ThatTurnOneWayHaveNone) {
  Random random(6);
  std::vector<std::pair<std::string, Triangles>> bodies{{"helix", helix()}, {"snub cube", snub_cube()}};
  for (const unsigned n : {2U, 3U, 4U, 5U, 7U}) bodies.emplace_back("propeller of " + std::to_string(n), propeller(n, 0.5));
  bodies.emplace_back("propeller of little pitch", propeller(3, 0.05));
  for (const unsigned n : {3U, 4U, 6U, 11U}) bodies.emplace_back("cone of teeth of " + std::to_string(n), cone_of_teeth(n));
  for (const auto& [name, body] : bodies) {
    for (const double noise : {0.0, 1e-4}) {
      for (int turn = noise > 0 ? 1 : 0; turn < (test::long_tests() ? 3 : 2); ++turn) {
        SCOPED_TRACE(name + ", noise " + std::to_string(noise) + ", turn " + std::to_string(turn));
        Place place;
        if (turn > 0) place = {any_turn(random), {1, -2, 3}, 1e3};
        const Triangles triangles = put(body, place, noise, random);
        EXPECT_TRUE(surface_mirrors(triangles, 8e-4 * diagonal_of(triangles)).planes.empty());
      }
    }
  }
}

// As told: by distances from all triangles.
TEST(MirrorBodies, AreAsFarFromTheirImagesAsIsTold) {
  Random random(7);
  const Triangles triangles = put(wheel(random, 5), {any_turn(random), {1, 2, 3}, 1}, 2e-4, random);
  const SurfaceMirrors found = surface_mirrors(triangles, 1e-3 * diagonal_of(triangles));
  ASSERT_EQ(found.planes.size(), 2u);
  double most = 0;
  for (const CagePlane& plane : found.planes) {
    for (const TriangleCorners& corners : triangles) {
      for (const Vec3& x : corners) {
        const Vec3 image = x - 2 * dot(plane.normal, x - plane.point) * plane.normal;
        double least = 1e300;
        for (const TriangleCorners& t : triangles) least = std::min(least, distance(image, closest_point(t, image)));
        most = std::max(most, least);
      }
    }
  }
  EXPECT_NEAR(found.deviation, most, 1e-12);
}

}  // namespace
}  // namespace deform::mirror_bodies_test
