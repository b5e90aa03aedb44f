// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/measures/clearance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/core/measures/measure_checks.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::measures::clearance_test {
namespace {

using test::expect_error;

/// A mesh of one small triangle at a place.
Mesh probe(const Vec3& x, double size) {
  Mesh mesh;
  mesh.points = {x, x + Vec3{size, 0, 0}, x + Vec3{0, size, 0}};
  test::add_face(mesh, {0, 1, 2});
  return mesh;
}

double box_distance(const Box& box, const Vec3& x) {
  Vec3 nearest;
  double inside = HUGE_VAL;
  for (std::size_t k = 0; k < 3; ++k) {
    nearest[k] = std::clamp(x[k], box.min[k], box.max[k]);
    inside = std::min({inside, x[k] - box.min[k], box.max[k] - x[k]});
  }
  return inside > 0 ? -inside : distance(x, nearest);
}

Mesh box_mesh(const Box& box, std::uint32_t cells) {
  Mesh mesh = test::block(box.max - box.min, cells);
  for (Vec3& p : mesh.points) p = p + box.min;
  return mesh;
}

TEST(Clearance, OfABoxAndOfItsMesh) {
  std::mt19937_64 random(3);
  for (const double unit : {1e-3, 1.0, 5e3}) {
    const Box box{{-unit, 2 * unit, 0}, {unit, 3 * unit, 4 * unit}};
    std::uniform_real_distribution<double> uniform(-2 * unit, 5 * unit);
    Mesh inwards = box_mesh(box, 3);
    for (std::size_t f = 0; f < inwards.face_count(); ++f)
      std::swap(inwards.face_points[4 * f + 1], inwards.face_points[4 * f + 3]);
    int inside = 0;
    for (int i = 0; i < 150; ++i) {
      Vec3 place{uniform(random), uniform(random), uniform(random)};
      if (i % 2 == 0) place = {place[0] / 3, 2 * unit + std::abs(place[1]) / 4, std::abs(place[2])};  // mostly inside
      const Mesh mesh = probe(place, 1e-3 * unit);
      double least = HUGE_VAL;
      for (const Vec3& p : mesh.points) least = std::min(least, box_distance(box, p));
      inside += least < 0 ? 1 : 0;
      for (const KeepOut& keep_out :
           {KeepOut{box}, KeepOut{box_mesh(box, 3)}, KeepOut{inwards}, KeepOut{test::torn(box_mesh(box, 2))}}) {
        const Measurement found = make_clearance(mesh, {}, keep_out, 1e-2 * unit)->evaluate(mesh.points, Gradients::wanted);
        ASSERT_NEAR(found.least->value, least, 1e-12 * unit);
        EXPECT_LE(found.values[0], found.least->value);
        EXPECT_GE(found.values[0], found.least->value - 1e-2 * unit * (1 + 1e-9));
        EXPECT_EQ(found.least->at, mesh.points[found.least->index]);
        EXPECT_EQ(found.least->tolerance, 1e-2 * unit);
        EXPECT_EQ(found.least->samples, 3U);
      }
    }
    EXPECT_GT(inside, 20);
    EXPECT_LT(inside, 130);
  }
}

TEST(Clearance, GradientsAreThoseOfDifferences) {
  for (const double unit : {1e-3, 1.0, 1e4}) {
    const Mesh mesh = test::sphere(unit, 3);
    const Points points = test::plus(mesh.points, 0.02 * unit, test::waves(mesh.points, 1, 4));
    const Box near{{0.2 * unit, -0.1 * unit, 0.3 * unit}, {3 * unit, 2 * unit, 2 * unit}},
        apart{{2 * unit, -5 * unit, -5 * unit}, {3 * unit, 5 * unit, 5 * unit}};
    Mesh ball = test::sphere(0.8 * unit, 2), distant = ball;
    for (Vec3& p : ball.points) p = p + Vec3{unit, 0.4 * unit, 0.1 * unit};
    for (Vec3& p : distant.points) p = p + Vec3{2.5 * unit, 0.4 * unit, 0.1 * unit};
    for (const KeepOut& keep_out : {KeepOut{near}, KeepOut{apart}, KeepOut{ball}, KeepOut{distant}}) {
      test::expect_gradient(*make_clearance(mesh, {}, keep_out, 0.1 * unit), points, 1e-5, 1e-7);
    }
  }
}

TEST(Clearance, OfABallIsNearlyThatOfItsRadius) {
  const Mesh ball = test::sphere(1, 5);
  double sagitta = 0;
  for (std::size_t t = 0; t < ball.face_count(); ++t) {
    const Vec3 middle = (ball.points[ball.face_points[3 * t]] + ball.points[ball.face_points[3 * t + 1]] +
                         ball.points[ball.face_points[3 * t + 2]]) /
                        3;
    sagitta = std::max(sagitta, 1 - length(middle));
  }
  std::mt19937_64 random(8);
  std::uniform_real_distribution<double> uniform(-1.5, 1.5);
  for (int i = 0; i < 60; ++i) {
    const Mesh mesh = probe({uniform(random), uniform(random), uniform(random)}, 1e-9);
    const Measurement found = make_clearance(mesh, {}, ball, 1e-6)->evaluate(mesh.points, Gradients::left_out);
    EXPECT_NEAR(found.least->value, length(mesh.points[0]) - 1, sagitta + 1e-8);
  }
}

TEST(Clearance, OnlyOfTheChosenFacesAndNotOfOtherPoints) {
  Mesh mesh = test::sphere(1, 2);
  mesh.points.push_back({5, 5, 5});  // of no face, in the keep-out
  mesh.groups = {{"one", {}, {0}}};
  const Box box{{4, 4, 4}, {6, 6, 6}};
  EXPECT_GT(make_clearance(mesh, {}, box, 0)->evaluate(mesh.points, Gradients::left_out).least->value, 3);
  const auto found = make_clearance(mesh, {{"one"}, {}}, box, 0.1)->evaluate(mesh.points, Gradients::wanted);
  EXPECT_EQ(found.least->samples, 3U);
  int moved = 0;
  for (const Vec3& slope : found.gradients[0]) moved += length(slope) > 0 ? 1 : 0;
  EXPECT_EQ(moved, 3);
}

TEST(Clearance, CoveringHoldsForAllPlacesOfTheFaces) {
  const Mesh mesh = test::sphere(1, 1);
  const Points points = test::shaken(mesh.points, 0.2, 6);
  const Box box{{0.9, 0.2, -0.3}, {2, 2, 2}};
  const Least least = *make_clearance(mesh, {}, box, 0)->evaluate(points, Gradients::left_out).least;
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> uniform(0, 1);
  double longest = 0, nearest = HUGE_VAL;
  for (std::size_t t = 0; t < mesh.face_count(); ++t) {
    std::array<Vec3, 3> c;
    for (std::size_t i = 0; i < 3; ++i) c[i] = points[mesh.face_points[3 * t + i]];
    for (std::size_t i = 0; i < 3; ++i) longest = std::max(longest, distance(c[i], c[(i + 1) % 3]));
    for (int i = 0; i < 300; ++i) {
      double s = uniform(random), v = uniform(random);
      if (s + v > 1) s = 1 - s, v = 1 - v;
      const Vec3 x = c[0] + s * (c[1] - c[0]) + v * (c[2] - c[0]);
      nearest = std::min(nearest, box_distance(box, x));
      double to_corner = HUGE_VAL;
      for (const Vec3& corner : c) to_corner = std::min(to_corner, distance(x, corner));
      ASSERT_LE(to_corner, least.covering);
    }
  }
  EXPECT_NEAR(least.covering, longest / std::sqrt(3.0), 1e-14);
  EXPECT_LT(nearest, least.value);  // a face does reach farther in than its corners
  EXPECT_GE(nearest, least.value - least.covering);
}

TEST(Clearance, OnTheSurfaceOfAMeshTheGradientIsItsNormal) {
  const Box box{{0, 0, 0}, {2, 2, 2}};
  const Mesh mesh = probe({2, 0.7, 0.9}, 1e-3), far = probe({2 + 1e-14, 0.7, 0.9}, 1e-3);
  for (const Mesh& each : {mesh, far}) {
    const auto found = make_clearance(each, {}, box_mesh(box, 1), 1e-9)->evaluate(each.points, Gradients::wanted);
    EXPECT_NEAR(found.least->value, 0, 1e-13);
    EXPECT_NEAR(found.gradients[0][0][0] + found.gradients[0][1][0] + found.gradients[0][2][0], 1, 1e-9);
  }
}

TEST(Clearance, OnTheSurfaceOfABoxTheGradientIsItsNormal) {
  const Mesh mesh = probe({1, 3, 0.5}, 0);
  const Box box{{0, 1, 0}, {2, 3, 2}};
  const auto found = make_clearance(mesh, {}, box, 0.1)->evaluate(mesh.points, Gradients::wanted);
  EXPECT_EQ(found.least->value, 0);
  Vec3 sum{};
  for (const Vec3& slope : found.gradients[0]) sum = sum + slope;
  EXPECT_LT(distance(sum, {0, 1, 0}), 1e-14);
}

TEST(Clearance, SameBitsForAnyNumberOfThreads) {
  const Mesh mesh = test::sphere(1, 5);
  Mesh ball = test::sphere(0.5, 3);
  for (Vec3& p : ball.points) p[0] += 1;
  test::expect_same_bits(*make_clearance(mesh, {}, ball, 0), mesh.points);
}

TEST(Clearance, BadInput) {
  const Mesh mesh = test::sphere(1, 1);
  const Box box{{0, 0, 0}, {1, 1, 1}};
  for (const double tolerance : {-1.0, HUGE_VAL, std::nan("")}) {
    expect_error(ErrorCode::invalid_argument, {"tolerance: "}, [&] { make_clearance(mesh, {}, box, tolerance); });
  }
  expect_error(ErrorCode::invalid_argument, {"keep_out: y of min, 2, is above that of max, 1"}, [&] {
    make_clearance(mesh, {}, Box{{0, 2, 0}, {1, 1, 1}}, 0);
  });
  expect_error(ErrorCode::invalid_argument, {"keep_out.max", "z"}, [&] {
    make_clearance(mesh, {}, Box{{0, 0, 0}, {1, 1, std::nan("")}}, 0);
  });
  Mesh open = mesh;
  open.face_sizes.pop_back();
  open.face_points.resize(open.face_points.size() - 3);
  expect_error(ErrorCode::invalid_argument, {"keep_out: faces: the faces are not closed"},
               [&] { make_clearance(mesh, {}, open, 0); });
}

}  // namespace
}  // namespace deform::measures::clearance_test
