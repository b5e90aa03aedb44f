// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/measures/thickness.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/core/measures/measure_checks.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::measures::thickness_test {
namespace {

using test::expect_error;

using Corners = std::array<Vec3, 3>;

std::vector<Corners> corners_of(const Mesh& mesh, const Points& points) {
  std::vector<Corners> found;
  std::size_t at = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    for (std::size_t i = 2; i < size; ++i) {
      found.push_back({points[mesh.face_points[at]], points[mesh.face_points[at + i - 1]], points[mesh.face_points[at + i]]});
    }
    at += size;
  }
  return found;
}

Vec3 unit_normal(const Corners& c) {
  const Vec3 n = cross(c[1] - c[0], c[2] - c[0]);
  return n / norm(n);
}

Vec3 middle(const Corners& c) { return (c[0] + c[1] + c[2]) / 3; }

/// All triangles, by the plane and the signs of areas in it. Neighbours of an edge both count.
double ray_by_search(const std::vector<Corners>& all, std::size_t from) {
  const Vec3 x = middle(all[from]), d = -1.0 * unit_normal(all[from]);
  double least = HUGE_VAL;
  for (std::size_t t = 0; t < all.size(); ++t) {
    const Vec3 n = unit_normal(all[t]);
    if (t == from || dot(n, d) <= 0) continue;
    const double at = dot(all[t][0] - x, n) / dot(d, n);
    const Vec3 hit = x + at * d;
    bool inside = at >= 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const Vec3 edge = all[t][(i + 1) % 3] - all[t][i];
      inside = inside && dot(cross(edge, hit - all[t][i]), n) >= -1e-13 * dot(edge, edge);
    }
    if (inside) least = std::min(least, at);
  }
  return least;
}

/// The least |w|^2 / (2 w.u) over a triangle, by a search over finer and finer lattices of its points.
double radius_of(const Corners& c, const Vec3& x, const Vec3& u) {
  const auto at = [&](double s, double t) {
    const Vec3 w = c[0] + s * (c[1] - c[0]) + t * (c[2] - c[0]) - x;
    const double depth = dot(w, u);
    return depth > 0 ? dot(w, w) / (2 * depth) : HUGE_VAL;
  };
  double best = HUGE_VAL, s0 = 0.5, t0 = 0.5, width = 0.5;
  for (int level = 0; level < 30; ++level, width *= 0.6) {
    const double s_middle = s0, t_middle = t0;
    for (int i = -6; i <= 6; ++i) {
      for (int j = -6; j <= 6; ++j) {
        double s = std::clamp(s_middle + width * i / 6, 0.0, 1.0), t = std::clamp(t_middle + width * j / 6, 0.0, 1.0);
        if (s + t > 1) {
          const double beyond = (s + t - 1) / 2;
          s = std::clamp(s - beyond, 0.0, 1.0);
          t = 1 - s;
        }
        const double radius = at(s, t);
        if (radius < best) {
          best = radius;
          s0 = s;
          t0 = t;
        }
      }
    }
  }
  return best;
}

double sphere_by_search(const std::vector<Corners>& all, std::size_t from, double degrees) {
  const Vec3 x = middle(all[from]), u = -1.0 * unit_normal(all[from]);
  double least = HUGE_VAL;
  for (const Corners& c : all) {
    if (dot(u, unit_normal(c)) >= std::cos(degrees * std::numbers::pi / 180)) least = std::min(least, radius_of(c, x, u));
  }
  return 2 * least;
}

Measurement measured(const Mesh& mesh, const Points& points, const ThicknessOptions& options) {
  return make_thickness(mesh, options)->evaluate(points, Gradients::wanted);
}

/// A plate whose sides are waves: thin in some places.
Mesh wavy_plate(double unit) {
  Mesh mesh = test::block({4 * unit, 3 * unit, unit}, 5);
  for (Vec3& p : mesh.points) p[2] += 0.2 * unit * (p[2] / unit - 0.3) * std::sin(1.3 * p[0] / unit + 0.4 * p[1] / unit);
  return mesh;
}

TEST(Thickness, OfABlockIsItsShortestEdge) {
  for (const double unit : {1e-4, 1.0, 1e3}) {
    const Mesh mesh = test::block({3 * unit, 2 * unit, 0.25 * unit}, 5);
    for (const ThicknessMethod method : {ThicknessMethod::rays, ThicknessMethod::spheres}) {
      ThicknessOptions options;
      options.method = method;
      const Measurement found = measured(mesh, mesh.points, options);
      EXPECT_NEAR(found.least->value, 0.25 * unit, 1e-13 * unit);
      EXPECT_NEAR(found.least->tolerance, 0.05 * 0.25 * unit, 1e-14 * unit);
      EXPECT_LE(found.values[0], found.least->value);
      EXPECT_GE(found.values[0], 0.95 * 0.25 * unit * (1 - 1e-12));
      EXPECT_EQ(found.least->samples, 300U);
      // Moving the upper side up by 1 adds 1.
      double up = 0;
      for (std::size_t i = 0; i < mesh.point_count(); ++i) up += mesh.points[i][2] > 0.2 * unit ? found.gradients[0][i][2] : 0;
      EXPECT_NEAR(up, 1, 1e-9);
    }
  }
}

TEST(Thickness, IsThatOfASearchOverAllTriangles) {
  for (const double unit : {1e-3, 1.0, 1e4}) {
    const Mesh mesh = wavy_plate(unit);
    const Points points = test::plus(mesh.points, 0.05 * unit, test::waves(mesh.points, 1, 3));
    const std::vector<Corners> all = corners_of(mesh, points);
    double ray = HUGE_VAL, sphere = HUGE_VAL;
    for (std::size_t t = 0; t < all.size(); t += 5) sphere = std::min(sphere, sphere_by_search(all, t, 40));
    for (std::size_t t = 0; t < all.size(); ++t) ray = std::min(ray, ray_by_search(all, t));
    ThicknessOptions options;
    options.tolerance = 0.01 * unit;
    EXPECT_NEAR(measured(mesh, points, options).least->value, ray, 1e-9 * unit);
    options.method = ThicknessMethod::spheres;
    options.opposing_degrees = 40;
    const Measurement found = measured(mesh, points, options);
    EXPECT_LE(found.least->value, sphere * (1 + 1e-9));
    EXPECT_GE(found.least->value, 0.5 * sphere);
    // The place that it names has that sphere.
    std::size_t place = 0;
    for (std::size_t t = 0; t < all.size(); ++t)
      place = distance(middle(all[t]), found.least->at) < distance(middle(all[place]), found.least->at) ? t : place;
    EXPECT_LT(distance(middle(all[place]), found.least->at), 1e-12 * unit);
    EXPECT_EQ(found.least->index, place / 2);  // faces are quads
    EXPECT_NEAR(sphere_by_search(all, place, 40), found.least->value, 1e-8 * unit);
  }
}

TEST(Thickness, EachFaceHasThatOfASearch) {
  Mesh mesh = wavy_plate(1);
  const std::vector<Corners> all = corners_of(mesh, mesh.points);
  for (FaceId f = 0; f < mesh.face_count(); f += 13) {
    mesh.groups = {{"one", {}, {f}}};
    for (const ThicknessMethod method : {ThicknessMethod::rays, ThicknessMethod::spheres}) {
      ThicknessOptions options;
      options.at = {"one"};
      options.method = method;
      options.tolerance = 0.1;
      double least = HUGE_VAL;
      for (const std::size_t t : {2 * f, 2 * f + 1}) {
        least = std::min(
            least, method == ThicknessMethod::rays ? ray_by_search(all, t) : sphere_by_search(all, t, options.opposing_degrees));
      }
      EXPECT_NEAR(measured(mesh, mesh.points, options).least->value, least, 1e-8);
    }
  }
}

TEST(Thickness, GradientsAreThoseOfDifferences) {
  for (const double unit : {1e-3, 1.0, 1e4}) {
    const Mesh mesh = wavy_plate(unit);
    const Points points = test::plus(mesh.points, 0.05 * unit, test::waves(mesh.points, 1, 6));
    for (const ThicknessMethod method : {ThicknessMethod::rays, ThicknessMethod::spheres}) {
      ThicknessOptions options;
      options.method = method;
      options.tolerance = 0.05 * unit;
      test::expect_gradient(*make_thickness(mesh, options), points, 2e-6, 1e-7);
    }
  }
}

TEST(Thickness, OfABallIsItsDiameter) {
  const Mesh mesh = test::sphere(3, 4);
  ThicknessOptions options;
  EXPECT_NEAR(measured(mesh, mesh.points, options).least->value, 6, 0.05);
  options.method = ThicknessMethod::spheres;  // which the tilt of the facets pushes to the side
  EXPECT_NEAR(measured(mesh, mesh.points, options).least->value, 6, 0.15);
}

TEST(Thickness, SpheresBetweenSidesThatOppose) {
  // A prism of three sides, whose normals are 60 degrees from the opposite ones. The centroids of its triangles are at a third of
  // the sides: the sphere touches both sides of the nearer edge at that distance from it.
  const Mesh mesh = test::tube(0.5, 3, 4, 1, test::Faces::triangles);
  const double side = 0.5 * std::numbers::sqrt3;
  ThicknessOptions options;
  options.rims = Rims::close;
  options.method = ThicknessMethod::spheres;
  options.opposing_degrees = 61;
  const Measurement found = measured(mesh, mesh.points, options);
  EXPECT_NEAR(found.least->value, 2 * side / 3 * std::tan(std::numbers::pi / 6), 1e-12);
  EXPECT_EQ(found.least->samples, 24U);
  options.opposing_degrees = 59;
  expect_error(ErrorCode::numerical_failure, {"faces: the body has no thickness"}, [&] { make_thickness(mesh, options); });
  const Mesh block = test::block({1, 1, 1}, 10);
  EXPECT_NEAR(measured(block, block.points, {}).least->value, 1, 1e-12);
}

TEST(Thickness, ThroughRimsAndOfTurnedFaces) {
  Mesh mesh = test::tube(0.5, 32, 6, 10, test::Faces::quads);
  ThicknessOptions options;
  options.rims = Rims::close;
  const double across = 2 * 0.5 * std::cos(std::numbers::pi / 32);
  EXPECT_NEAR(measured(mesh, mesh.points, options).least->value, across, 1e-12);
  for (std::size_t f = 0; f < mesh.face_count(); ++f) std::swap(mesh.face_points[4 * f + 1], mesh.face_points[4 * f + 3]);
  EXPECT_NEAR(measured(mesh, mesh.points, options).least->value, across, 1e-12);
  options.rims = Rims::refuse;
  expect_error(ErrorCode::invalid_argument, {"faces: the faces are not closed"}, [&] { make_thickness(mesh, options); });
  // A box without its lid: rays of its floor leave through it.
  Mesh box = test::block({1, 1, 1}, 2);
  box.face_sizes.resize(box.face_sizes.size() - 4);
  box.face_points.resize(box.face_points.size() - 16);
  options.rims = Rims::close;
  options.tolerance = 0.01;
  const Measurement found = measured(box, box.points, options);
  EXPECT_NEAR(found.least->value, 1, 1e-12);
  EXPECT_EQ(found.least->samples, 2 * (24 - 4 - 4U));
}

TEST(Thickness, DegenerateFacesDoNotCount) {
  Mesh mesh = test::block({1, 1, 0.5}, 2);
  const PointId a = mesh.face_points[0], b = mesh.face_points[1];
  test::add_face(mesh, {a, b, a});
  const Measurement found = measured(mesh, mesh.points, {});
  EXPECT_NEAR(found.least->value, 0.5, 1e-13);
  for (const Vec3& slope : found.gradients[0]) EXPECT_TRUE(is_finite(slope));
}

TEST(Thickness, SameBitsForAnyNumberOfThreads) {
  const Mesh mesh = wavy_plate(1);
  for (const ThicknessMethod method : {ThicknessMethod::rays, ThicknessMethod::spheres}) {
    ThicknessOptions options;
    options.method = method;
    options.tolerance = 0.2;
    test::expect_same_bits(*make_thickness(mesh, options), test::shaken(mesh.points, 0.01, 3));
  }
}

TEST(Thickness, BadInput) {
  Mesh mesh = test::block({1, 1, 1}, 2);
  mesh.groups = {{"points", {1}, {}}, {"side", {}, {0, 1}}, {"rest", {}, {}}};
  for (FaceId f = 4; f < mesh.face_count(); ++f) mesh.groups[2].faces.push_back(f);
  const auto refused = [&](const std::vector<const char*>& parts, const auto& change) {
    ThicknessOptions options;
    change(options);
    expect_error(ErrorCode::invalid_argument, parts, [&] { make_thickness(mesh, options); });
  };
  refused({"tolerance: -1, expected"}, [](auto& options) { options.tolerance = -1; });
  refused({"tolerance: "}, [](auto& options) { options.tolerance = HUGE_VAL; });
  refused({"opposing_degrees: 91, expected 0 to 90"}, [](auto& options) { options.opposing_degrees = 91; });
  refused({"opposing_degrees: "}, [](auto& options) { options.opposing_degrees = std::nan(""); });
  refused({"at[0]: there is no group \"sid\"", "side"}, [](auto& options) { options.at = {"sid"}; });
  refused({"at[1]: group \"points\" has no faces"}, [](auto& options) { options.at = {"side", "points"}; });
  refused({"at: none of these faces belongs to the body"}, [](auto& options) {
    options.at = {"side"};
    options.body.groups = {"rest"};
    options.rims = Rims::close;
  });
  ThicknessOptions options;
  options.tolerance = 0.1;
  const auto measure = make_thickness(mesh, options);
  Points inside_out = mesh.points;
  for (Vec3& p : inside_out) p[0] = -p[0];
  expect_error(ErrorCode::numerical_failure, {"points: the body has no thickness"},
               [&] { measure->evaluate(inside_out, Gradients::left_out); });
}

}  // namespace
}  // namespace deform::measures::thickness_test
