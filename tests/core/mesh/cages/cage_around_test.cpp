// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/cages/cage_around.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <limits>
#include <random>
#include <set>
#include <string>

#include "core/base/vectors.h"
#include "core/mesh/ahmed.h"
#include "core/mesh/cages/crossing_triangles.h"
#include "tests/core/mesh/cages/cage_checks.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform {
namespace {

using test::expect_cage;
using test::expect_error;

TEST(CageAround, OfEveryKindAndSize) {
  const Mesh car = ahmed_body({.target_points = 2000});
  for (const CageKind kind : {CageKind::box, CageKind::hull, CageKind::wrap}) {
    for (const std::size_t points : {60u, 800u}) {
      SCOPED_TRACE(std::to_string(static_cast<int>(kind)) + " " + std::to_string(points));
      const CageAround cage = cage_around(car, {.kind = kind, .points = points});
      expect_cage(cage, car, points);
      EXPECT_EQ(cage.components, 1u);
      EXPECT_EQ(crossing_triangles(cage.mesh), 0u);
    }
  }
}

TEST(CageAround, DoesNotDependOnUnits) {
  const Mesh car = ahmed_body({.target_points = 2000});
  const CageAround usual = cage_around(car, {.points = 150});
  for (const double unit : {0x1p-40, 0x1p40}) {
    SCOPED_TRACE(unit);
    Mesh other = car;
    for (Vec3& x : other.points) x = unit * x;
    const CageAround cage = cage_around(other, {.points = 150});
    EXPECT_EQ(cage.mesh.face_points, usual.mesh.face_points);
    EXPECT_EQ(cage.offset, unit * usual.offset);
  }
}

TEST(CageAround, IsDeterministic) {
  const Mesh car = ahmed_body({.target_points = 2000});
  RunContext one;
  one.threads = 1;
  const CageAround first = cage_around(car, {.points = 200}, one), second = cage_around(car, {.points = 200});
  EXPECT_EQ(first.mesh.points, second.mesh.points);
  EXPECT_EQ(first.mesh.face_points, second.mesh.face_points);
}

TEST(CageAround, OfSoupsWithHolesAndOfPlanes) {
  const Mesh car = ahmed_body({.target_points = 2000});
  std::mt19937_64 random(3);
  // Every tenth face is missing, others are turned round, none shares a point with another.
  Mesh soup;
  std::size_t at = 0;
  for (const std::uint32_t size : car.face_sizes) {
    std::vector<PointId> corners(car.face_points.begin() + static_cast<std::ptrdiff_t>(at),
                                 car.face_points.begin() + static_cast<std::ptrdiff_t>(at + size));
    at += size;
    if (random() % 10 == 0) continue;
    if (random() % 2 == 0) std::reverse(corners.begin(), corners.end());
    soup.face_sizes.push_back(size);
    for (const PointId id : corners) {
      soup.face_points.push_back(static_cast<PointId>(soup.points.size()));
      soup.points.push_back(car.points[id]);
    }
  }
  Mesh cloud;
  cloud.points = car.points;
  const Mesh plane = test::quad_grid(12, 7), loose = test::with_loose_points();
  constexpr std::size_t points = 200;
  for (const Mesh* mesh : std::initializer_list<const Mesh*>{&soup, &cloud, &plane, &loose}) {
    for (const CageKind kind : {CageKind::box, CageKind::hull, CageKind::wrap}) {
      SCOPED_TRACE(static_cast<int>(kind));
      expect_cage(cage_around(*mesh, {.kind = kind, .points = points}), *mesh, points);
    }
  }
}

TEST(CageAround, WrapFollowsConcavitiesAndHullDoesNot) {
  // Two balls, 4 apart.
  Mesh balls = test::sphere(1, 4);
  const std::size_t half = balls.point_count(), corners = balls.face_points.size();
  for (std::size_t i = 0; i < half; ++i) balls.points.push_back(balls.points[i] + Vec3{4, 0, 0});
  for (std::size_t c = 0; c < corners; ++c) balls.face_points.push_back(balls.face_points[c] + static_cast<PointId>(half));
  balls.face_sizes.insert(balls.face_sizes.end(), balls.face_sizes.begin(), balls.face_sizes.end());
  const CageAround wrap = cage_around(balls, {.kind = CageKind::wrap, .points = 250}),
                   hull = cage_around(balls, {.kind = CageKind::hull, .points = 250});
  expect_cage(wrap, balls, 250);
  expect_cage(hull, balls, 250);
  EXPECT_EQ(wrap.components, 2u);
  EXPECT_EQ(hull.components, 1u);
  EXPECT_NEAR(test::winding_of(wrap.mesh, {2, 0, 0}), 0, 1e-9);
  EXPECT_NEAR(test::winding_of(hull.mesh, {2, 0, 0}), 1, 1e-9);
}

TEST(CageAround, KeepsTheOffsetThatIsAskedForWhereItIsEnough) {
  const Mesh ball = test::sphere(1, 4);
  const CageAround wide = cage_around(ball, {.points = 400, .offset = 0.5});
  EXPECT_EQ(wide.offset, 0.5);
  const CageAround widest = cage_around(ball, {.points = 60, .offset = 2.5});
  EXPECT_EQ(widest.offset, 2.5) << "what is asked for is tried, however wide";
  EXPECT_EQ(widest.attempts, 1);
  EXPECT_EQ(wide.attempts, 1);
  EXPECT_NEAR(wide.clearance, 0.5, 0.03);
  const CageAround narrow = cage_around(ball, {.points = 60, .offset = 0.05});
  EXPECT_GT(narrow.offset, 0.05) << "60 points on a ball of 1.05 cut it off";
  expect_cage(narrow, ball, 60);
  EXPECT_EQ(cage_around(ball, {.kind = CageKind::box, .points = 100, .offset = 0.25}).clearance, 0.25);
}

using Divisions = std::array<std::size_t, 3>;

/// All divisions of a box, by enumeration: the number of points that each has, and the sides of its rectangles, the longest over
/// the shortest.
template <typename Use>
void for_each_division(const Vec3& sides, std::size_t most, const Use& use) {
  for (std::size_t i = 1; i <= most; ++i) {
    for (std::size_t j = 1; j <= most; ++j) {
      for (std::size_t k = 1; k <= most; ++k) {
        // Of the (i + 1)(j + 1)(k + 1) points of the whole lattice those inside are none.
        const std::size_t points = (i + 1) * (j + 1) * (k + 1) - (i - 1) * (j - 1) * (k - 1);
        const std::array<double, 3> lengths{sides[0] / static_cast<double>(i), sides[1] / static_cast<double>(j),
                                            sides[2] / static_cast<double>(k)};
        use(points, *std::max_element(lengths.begin(), lengths.end()) / *std::min_element(lengths.begin(), lengths.end()));
      }
    }
  }
}

std::size_t coordinates(const Mesh& mesh, std::size_t axis) {
  std::set<double> distinct;
  for (const Vec3& x : mesh.points) distinct.insert(x[axis]);
  return distinct.size();
}

TEST(CageAround, BoxesHaveTheSquarestRectanglesOfAll) {
  std::size_t made = 0;
  for (const Vec3& sides : {Vec3{1, 1, 1}, Vec3{4, 1, 1}, Vec3{10, 3, 2}, Vec3{1, 7, 6}}) {
    Mesh ends;
    ends.points = {{0, 0, 0}, sides};
    for (const std::size_t points : {26u, 98u, 300u, 1000u}) {
      SCOPED_TRACE(testing::Message() << sides[0] << " x " << sides[1] << " x " << sides[2] << ", " << points);
      Vec3 lengths;
      for (std::size_t k = 0; k < 3; ++k) lengths[k] = sides[k] + 0.2;
      const auto wanted = static_cast<double>(points);
      double squarest = std::numeric_limits<double>::infinity();
      for_each_division(lengths, 60, [&](std::size_t count, double ratio) {
        if (std::abs(static_cast<double>(count) - wanted) <= 0.05 * wanted) squarest = std::min(squarest, ratio);
      });
      if (squarest > 3.5) continue;  // refused: the next test
      ++made;
      const CageAround cage = cage_around(ends, {.kind = CageKind::box, .points = points, .offset = 0.1});
      std::array<double, 3> steps{};
      for (std::size_t k = 0; k < 3; ++k) steps[k] = lengths[k] / static_cast<double>(coordinates(cage.mesh, k) - 1);
      const double ratio = *std::max_element(steps.begin(), steps.end()) / *std::min_element(steps.begin(), steps.end());
      EXPECT_NEAR(ratio, squarest, 1e-9);
      expect_cage(cage, ends, points);
    }
  }
  EXPECT_GE(made, 12u);
}

TEST(CageAround, NamesTheNearestNumbersOfPointsOfABox) {
  for (const Vec3& sides : {Vec3{1, 1, 1}, Vec3{20, 1, 1}, Vec3{3, 2, 1}}) {
    Mesh ends;
    ends.points = {{0, 0, 0}, sides};
    Vec3 lengths;
    for (std::size_t k = 0; k < 3; ++k) lengths[k] = sides[k] + 0.2;
    for (std::size_t points = 8; points < 40; ++points) {
      SCOPED_TRACE(testing::Message() << sides[0] << " x " << sides[1] << " x " << sides[2] << ", " << points);
      const auto wanted = static_cast<double>(points);
      std::size_t below = 0, above = 0;
      bool possible = false;
      for_each_division(lengths, 40, [&](std::size_t count, double ratio) {
        if (ratio > 3.5) return;  // angles below 15.9 degrees
        possible = possible || std::abs(static_cast<double>(count) - wanted) <= 0.05 * wanted;
        if (count < points) below = std::max(below, count);
        if (count > points && (above == 0 || count < above)) above = count;
      });
      const CageRequest request{.kind = CageKind::box, .points = points, .offset = 0.1};
      if (possible) {
        EXPECT_NO_THROW((void)cage_around(ends, request));
        continue;
      }
      const std::string asked = "no " + std::to_string(points) + " points";
      const std::string near = "near are " + (below > 0 ? std::to_string(below) + " and " : "") + std::to_string(above);
      expect_error(ErrorCode::invalid_argument, {"points", asked.c_str(), near.c_str()},
                   [&] { (void)cage_around(ends, request); });
    }
  }
}

TEST(CageAround, RefusesWhatCannotBe) {
  const Mesh ball = test::sphere(1, 3);
  expect_error(ErrorCode::invalid_argument, {"points", "7", "8 to 10000"}, [&] { (void)cage_around(ball, {.points = 7}); });
  expect_error(ErrorCode::invalid_argument, {"offset", "-1"}, [&] { (void)cage_around(ball, {.offset = -1}); });
  expect_error(ErrorCode::invalid_argument, {"offset", "too small"}, [&] { (void)cage_around(ball, {.offset = 1e-6}); });
  expect_error(ErrorCode::invalid_argument, {"no points"}, [] { (void)cage_around({}, {}); });
  Mesh spot;
  spot.points = {{1, 2, 3}, {1, 2, 3}};
  expect_error(ErrorCode::invalid_argument, {"coincide"}, [&] { (void)cage_around(spot, {}); });
  expect_error(ErrorCode::invalid_argument, {"points", "near are 8 and"},
               [&] { (void)cage_around(ball, {.kind = CageKind::box, .points = 9}); });
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  expect_error(ErrorCode::cancelled, {}, [&] { (void)cage_around(ball, {}, context); });
}

}  // namespace
}  // namespace deform
