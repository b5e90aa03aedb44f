// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/cages/cage_around.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <random>
#include <set>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/mesh/ahmed.h"
#include "core/mesh/cages/crossing_triangles.h"
#include "tests/core/mesh/cages/cage_checks.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::cage_around_test {
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

/// The faces of a mesh where the first `planes` coordinates are 0 or more, with their points.
Mesh part_of(const Mesh& mesh, std::size_t planes) {
  Mesh part;
  std::map<PointId, PointId> numbers;
  std::size_t at = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    const std::span<const PointId> corners(mesh.face_points.data() + at, size);
    at += size;
    const bool kept = std::all_of(corners.begin(), corners.end(), [&](PointId id) {
      const Vec3& x = mesh.points[id];
      return std::all_of(x.begin(), x.begin() + static_cast<std::ptrdiff_t>(planes), [](double c) { return c >= 0; });
    });
    if (!kept) continue;
    part.face_sizes.push_back(size);
    for (const PointId id : corners) {
      const auto [found, added] = numbers.try_emplace(id, static_cast<PointId>(part.points.size()));
      if (added) part.points.push_back(mesh.points[id]);
      part.face_points.push_back(found->second);
    }
  }
  return part;
}

Vec3 reflected_in(const CagePlane& plane, const Vec3& x) {
  return x - (2 * dot(plane.normal, x - plane.point) / dot(plane.normal, plane.normal)) * plane.normal;
}

/// Vertices and triangles are images of each other.
void expect_own_image(const Mesh& cage, const CagePlane& plane) {
  const Points& at = cage.points;
  const double near = 1e-13 * (bounding_box(at).diagonal() + norm(plane.point));
  std::set<std::set<PointId>> triangles;
  for (std::size_t c = 0; c < cage.face_points.size(); c += 3) {
    triangles.insert({cage.face_points[c], cage.face_points[c + 1], cage.face_points[c + 2]});
  }
  std::vector<PointId> image;
  for (const Vec3& x : at) {
    const Vec3 to = reflected_in(plane, x);
    const auto found = std::find_if(at.begin(), at.end(), [&](const Vec3& y) { return distance(y, to) <= near; });
    ASSERT_NE(found, at.end());
    image.push_back(static_cast<PointId>(found - at.begin()));
  }
  for (const std::set<PointId>& t : triangles) {
    std::set<PointId> to;
    for (const PointId id : t) to.insert(image[id]);
    ASSERT_EQ(triangles.count(to), 1u);
  }
}

/// The cage of a half model: all that is promised of a cage around the whole model, and that it is its own mirror image.
void expect_half_cage(const CageAround& cage, const Mesh& half, const std::vector<CagePlane>& planes, std::size_t points) {
  Mesh whole = half;
  for (const CagePlane& plane : planes) {
    for (std::size_t i = 0, count = whole.points.size(); i < count; ++i) {
      whole.points.push_back(reflected_in(plane, whole.points[i]));
    }
  }
  expect_cage(cage, whole, points);
  EXPECT_EQ(crossing_triangles(cage.mesh), 0u);
  const Points& at = cage.mesh.points;
  const double near = 1e-13 * bounding_box(at).diagonal();
  std::size_t first = at.size();  // of the vertices on the side of the mesh
  for (const CagePlane& plane : planes) {
    expect_own_image(cage.mesh, plane);
    const double side = dot(plane.normal, half.points[0] + half.points[half.point_count() / 2] - 2.0 * plane.point);
    for (std::size_t i = 0; i < at.size(); ++i) {
      if (side * dot(plane.normal, at[i] - plane.point) < -near * std::abs(side) * norm(plane.normal)) first = std::min(first, i);
    }
  }
  EXPECT_GE(first << planes.size(), at.size()) << "those on the side of the mesh come first";
}

TEST(CageAround, OfHalfModelsIsItsOwnMirrorImage) {
  const Mesh car = ahmed_body({.target_points = 2000});
  Mesh turned = car;  // the symmetry plane becomes x = 0
  for (Vec3& x : turned.points) x = {x[1], -x[0], x[2]};
  const Mesh ball = test::sphere(1, 4);
  const std::array<Vec3, 3> axes{{{2, 0, 0}, {0, -3, 0}, {0, 0, 1}}};
  for (const CageKind kind : {CageKind::hull, CageKind::wrap}) {
    for (const std::size_t points : {60u, 400u}) {
      SCOPED_TRACE(std::to_string(static_cast<int>(kind)) + " " + std::to_string(points));
      const std::vector<CagePlane> one{{{0, 5, 1}, {2, 0, 0}}};
      const Mesh half = part_of(turned, 1);
      const CageAround cage = cage_around(half, {.kind = kind, .points = points, .planes = one});
      expect_half_cage(cage, half, one, points);
      EXPECT_EQ(cage.components, 1u);
      for (std::size_t count = 1; count <= 3; ++count) {
        std::vector<CagePlane> planes;
        for (std::size_t k = 0; k < count; ++k) planes.push_back({{0, 0, 0}, axes[k]});
        const Mesh part = part_of(ball, count);
        expect_half_cage(cage_around(part, {.kind = kind, .points = points, .planes = planes}), part, planes, points);
      }
    }
  }
}

// Turned and moved, in millimetres, and on the other side of the plane.
TEST(CageAround, OfHalfModelsInAnyDirectionAndUnit) {
  const Mesh half = part_of(test::sphere(1, 4), 2);
  const std::vector<CagePlane> planes{{{0, 0, 0}, {1, 0, 0}}, {{0, 0, 0}, {0, 1, 0}}};
  const CageAround usual = cage_around(half, {.points = 150, .planes = planes});
  const double c = std::cos(0.7), s = std::sin(0.7);
  const auto turned = [&](const Vec3& x) { return Vec3{c * x[0] - s * x[2], -x[1], s * x[0] + c * x[2]}; };
  const Vec3 moved{3, -7, 2};
  for (const double unit : {1.0, 1000.0}) {
    Mesh other = half;
    for (Vec3& x : other.points) x = unit * (turned(x) + moved);
    std::vector<CagePlane> there;
    for (const CagePlane& plane : planes) there.push_back({unit * moved, turned(plane.normal)});
    const CageAround cage = cage_around(other, {.points = 150, .planes = there});
    expect_half_cage(cage, other, there, 150);
    EXPECT_NEAR(cage.offset / unit, usual.offset, 1e-6 * usual.offset);
  }
}

// A model that does not touch the plane, and bores whose rims do.
TEST(CageAround, OfHalfModelsWithSeveralLoopsOrNoneInThePlane) {
  const std::vector<CagePlane> plane{{{0, 0, 0}, {1, 0, 0}}};
  Mesh beside = test::sphere(1, 4);
  for (Vec3& x : beside.points) x = x + Vec3{2.5, 0, 0};
  const CageAround two = cage_around(beside, {.points = 300, .planes = plane});
  expect_half_cage(two, beside, plane, 300);
  EXPECT_EQ(two.components, 2u);
  const CageAround joined = cage_around(beside, {.kind = CageKind::hull, .points = 300, .planes = plane});
  expect_half_cage(joined, beside, plane, 300);
  EXPECT_EQ(joined.components, 1u);
  // Half a ring, cut across: two loops.
  Mesh ring;
  constexpr unsigned n = 24, m = 16;
  for (unsigned i = 0; i <= n; ++i) {
    for (unsigned j = 0; j < m; ++j) {
      const double a = std::numbers::pi * (static_cast<double>(i) / n - 0.5), b = 2 * std::numbers::pi * j / m;
      const double across = i == 0 || i == n ? 0 : std::cos(a);
      ring.points.push_back({(1 + 0.3 * std::cos(b)) * across, (1 + 0.3 * std::cos(b)) * std::sin(a), 0.3 * std::sin(b)});
      if (i == n) continue;
      ring.face_sizes.push_back(4);
      for (const PointId id : {i * m + j, (i + 1) * m + j, (i + 1) * m + (j + 1) % m, i * m + (j + 1) % m}) {
        ring.face_points.push_back(id);
      }
    }
  }
  const CageAround open = cage_around(ring, {.points = 600, .planes = plane});
  expect_half_cage(open, ring, plane, 600);
  EXPECT_EQ(open.genus, 1u);
}

TEST(CageAround, RefusesPlanesThatCannotBe) {
  const Mesh half = part_of(test::sphere(1, 3), 1);
  const auto refused = [&](std::vector<CagePlane> planes, const std::vector<const char*>& parts, CageKind kind = CageKind::wrap) {
    expect_error(ErrorCode::invalid_argument, parts,
                 [&] { (void)cage_around(half, {.kind = kind, .planes = std::move(planes)}); });
  };
  const CagePlane x{{}, {1, 0, 0}}, y{{}, {0, 1, 0}}, z{{}, {0, 0, 1}};
  refused({x}, {"planes", "box", "lowest"}, CageKind::box);
  refused({x, y, z, x}, {"planes[3]", "at most 3"});
  refused({x, {{}, {0.01, 1, 0}}}, {"planes[1]", "not orthogonal to planes[0]", "0.0099"});
  refused({{{}, {0, 0, 0}}}, {"planes[0]", "must not be zero"});
  refused({{{NAN, 0, 0}, {0, 0, 1}}}, {"planes[0]", "finite"});
}

// Every fifth face of one side is split at a place that has no image.
TEST(CageAround, OfAModelThatIsItsOwnMirrorImageIsItsOwn) {
  Mesh car = ahmed_body({.target_points = 2000});
  std::size_t at = 0;
  Mesh split;
  split.points = car.points;
  for (std::size_t f = 0; f < car.face_count(); at += car.face_sizes[f++]) {
    const PointId a = car.face_points[at], b = car.face_points[at + 1], c = car.face_points[at + 2];
    if (car.face_sizes[f] == 3 && f % 5 == 0 && car.points[a][1] > 0) {
      const auto middle = static_cast<PointId>(split.points.size());
      split.points.push_back(0.5 * car.points[a] + 0.2 * car.points[b] + 0.3 * car.points[c]);
      split.face_sizes.insert(split.face_sizes.end(), 3, 3);
      split.face_points.insert(split.face_points.end(), {a, b, middle, b, c, middle, c, a, middle});
      continue;
    }
    split.face_sizes.push_back(car.face_sizes[f]);
    split.face_points.insert(split.face_points.end(), car.face_points.begin() + static_cast<std::ptrdiff_t>(at),
                             car.face_points.begin() + static_cast<std::ptrdiff_t>(at + car.face_sizes[f]));
  }
  ASSERT_GT(split.point_count(), car.point_count() + 20);
  const double c = std::cos(0.7), s = std::sin(0.7), diagonal = bounding_box(car.points).diagonal();
  for (const CageKind kind : {CageKind::hull, CageKind::wrap}) {
    for (const std::size_t points : {60u, 400u}) {
      for (const bool turned : {false, true}) {
        SCOPED_TRACE(std::to_string(static_cast<int>(kind)) + " " + std::to_string(points) + (turned ? " turned" : ""));
        Mesh mesh = split;
        for (Vec3& x : mesh.points) {
          if (turned) x = 1000.0 * Vec3{c * x[0] - s * x[1] + 3, s * x[0] + c * x[1] - 7, x[2]};
        }
        const CageAround cage = cage_around(mesh, {.kind = kind, .points = points});
        expect_cage(cage, mesh, points);
        EXPECT_EQ(crossing_triangles(cage.mesh), 0u);
        ASSERT_EQ(cage.planes.size(), 1u);
        EXPECT_NEAR(std::abs(dot(cage.planes[0].normal, turned ? Vec3{-s, c, 0} : Vec3{0, 1, 0})), 1, 1e-12);
        expect_own_image(cage.mesh, cage.planes[0]);
        EXPECT_LT(cage.asymmetry, 1e-6 * diagonal * (turned ? 1000 : 1));
        EXPECT_FALSE(cage.nearly_symmetric);
      }
    }
  }
}

// As half models are made: those of the model that is there.
TEST(CageAround, OfAWholeModelIsThatOfItsHalf) {
  const Mesh car = ahmed_body({.target_points = 2000});
  const CageAround whole = cage_around(car, {.points = 200});
  ASSERT_EQ(whole.planes.size(), 1u);
  const CageAround same = cage_around(car, {.points = 200, .planes = whole.planes});
  EXPECT_EQ(whole.mesh.points, same.mesh.points);
  EXPECT_EQ(whole.mesh.face_points, same.mesh.face_points);
}

// A loop of edges in each plane takes more vertices than there are.
TEST(CageAround, OfASymmetricModelWithFewPointsIsSymmetricToFewerPlanes) {
  const Mesh ball = test::sphere(1, 4);
  bool fewer = false, all = false;
  for (const std::size_t points : {8u, 9u, 12u, 14u, 20u, 60u}) {
    SCOPED_TRACE(points);
    const CageAround cage = cage_around(ball, {.points = points});
    expect_cage(cage, ball, points);
    ASSERT_EQ(cage.planes.size() + cage.without.size(), 3u);
    for (const CagePlane& plane : cage.planes) expect_own_image(cage.mesh, plane);
    for (std::size_t k = 0; k < 3; ++k) {
      const CagePlane& plane = k < cage.planes.size() ? cage.planes[k] : cage.without[k - cage.planes.size()];
      EXPECT_EQ(plane.normal[k], 1);
    }
    fewer = fewer || !cage.without.empty();
    all = all || cage.without.empty();
  }
  EXPECT_TRUE(fewer);
  EXPECT_TRUE(all);
}

TEST(CageAround, OfAModelThatIsNotSymmetricIsAsItWas) {
  Mesh car = ahmed_body({.target_points = 2000});
  const double diagonal = bounding_box(car.points).diagonal();
  const CageAround without = cage_around(car, {.points = 200, .symmetry_tolerance = 0});
  EXPECT_TRUE(without.planes.empty());
  EXPECT_FALSE(without.nearly_symmetric);
  expect_cage(without, car, 200);
  for (Vec3& x : car.points) {
    const double r = distance(x, {0.5, 0.2, 0.2}) / (0.1 * diagonal);
    x[1] += 1e-3 * diagonal * std::exp(-r * r);
  }
  const CageAround usual = cage_around(car, {.points = 200}), none = cage_around(car, {.points = 200, .symmetry_tolerance = 0});
  EXPECT_TRUE(usual.planes.empty());
  EXPECT_EQ(usual.mesh.points, none.mesh.points);
  EXPECT_EQ(usual.mesh.face_points, none.mesh.face_points);
  ASSERT_TRUE(usual.nearly_symmetric);
  EXPECT_EQ(usual.nearly_symmetric->plane.normal, (Vec3{0, 1, 0}));
  EXPECT_GT(usual.nearly_symmetric->deviation, 8e-4 * diagonal);
  EXPECT_LT(usual.nearly_symmetric->deviation, 1.01e-3 * diagonal);
  const CageAround wanted = cage_around(car, {.points = 200, .symmetry_tolerance = 1.1e-3});
  expect_cage(wanted, car, 200);
  ASSERT_EQ(wanted.planes.size(), 1u);
  expect_own_image(wanted.mesh, wanted.planes[0]);
  EXPECT_EQ(wanted.asymmetry, usual.nearly_symmetric->deviation);
}

using Divisions = std::array<std::size_t, 3>;

/// All divisions of a box, by enumeration: the number of points that each has, and the sides of its rectangles, the longest over
/// the shortest.
template <typename Use>
void for_each_division(const Vec3& sides, std::size_t most, const Use& use) {
  for (std::size_t i = 1; i <= most; ++i) {
    for (std::size_t j = 1; j <= most; ++j) {
      for (std::size_t k = 1; k <= most; ++k) {
        // Those of the (i + 1)(j + 1)(k + 1) points of the whole lattice that are inside are none of its.
        const std::size_t points = (i + 1) * (j + 1) * (k + 1) - (i - 1) * (j - 1) * (k - 1);
        const std::array<double, 3> lengths{sides[0] / static_cast<double>(i), sides[1] / static_cast<double>(j),
                                            sides[2] / static_cast<double>(k)};
        const double ratio =
            *std::max_element(lengths.begin(), lengths.end()) / *std::min_element(lengths.begin(), lengths.end());
        if constexpr (std::is_invocable_v<Use, std::size_t, double, const Divisions&>) {
          use(points, ratio, Divisions{i, j, k});
        } else {
          use(points, ratio);
        }
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

// All divisions that are even along the axes across the planes, too.
TEST(CageAround, BoxesOfSymmetricModelsAreTheirOwnMirrorImages) {
  const Mesh car = ahmed_body({.target_points = 2000}), ball = test::sphere(1, 4);
  for (const Mesh* mesh : {&car, &ball}) {
    const std::size_t planes = mesh == &car ? 1 : 3;
    const Box model = bounding_box(mesh->points);
    for (const std::size_t points : {26u, 98u, 300u, 1000u}) {
      SCOPED_TRACE(testing::Message() << planes << " planes, " << points << " points");
      const CageAround cage = cage_around(*mesh, {.kind = CageKind::box, .points = points, .offset = 0.1});
      expect_cage(cage, *mesh, points);
      ASSERT_EQ(cage.planes.size(), planes);
      EXPECT_TRUE(cage.without.empty());
      EXPECT_EQ(cage.asymmetry, 0);
      for (const CagePlane& plane : cage.planes) expect_own_image(cage.mesh, plane);
      Vec3 lengths{};
      std::array<std::size_t, 3> counts{};
      for (std::size_t k = 0; k < 3; ++k) {
        lengths[k] = model.side(static_cast<int>(k)) + 0.2;
        counts[k] = coordinates(cage.mesh, k) - 1;
      }
      const auto is_even = [&](const std::array<std::size_t, 3>& n) {
        return std::all_of(cage.planes.begin(), cage.planes.end(), [&](const CagePlane& plane) {
          return n[static_cast<std::size_t>(std::find(plane.normal.begin(), plane.normal.end(), 1) - plane.normal.begin())] % 2 ==
                 0;
        });
      };
      EXPECT_TRUE(is_even(counts));
      double squarest = std::numeric_limits<double>::infinity(), made = 0;
      for_each_division(lengths, 60, [&](std::size_t count, double ratio, const Divisions& n) {
        if (n == counts) made = ratio;
        if (!is_even(n)) return;
        if (std::abs(static_cast<double>(count) - static_cast<double>(points)) > 0.05 * static_cast<double>(points)) return;
        squarest = std::min(squarest, ratio);
      });
      EXPECT_NEAR(made, squarest, 1e-9);
    }
  }
}

// A box ends where the model and its image end.
TEST(CageAround, BoxesOfNearlySymmetricModelsHoldTheImages) {
  Mesh car = ahmed_body({.target_points = 2000});
  const double diagonal = bounding_box(car.points).diagonal(), bump = 5e-4 * diagonal;
  for (Vec3& x : car.points) {
    const double r = distance(x, {0.5, 0.2, 0.2}) / (0.1 * diagonal);
    x[1] += bump * std::exp(-r * r);
  }
  const CageAround cage = cage_around(car, {.kind = CageKind::box, .points = 98, .offset = 0.1});
  ASSERT_EQ(cage.planes.size(), 1u);
  expect_own_image(cage.mesh, cage.planes[0]);
  EXPECT_NEAR(cage.asymmetry, bump, 0.1 * bump);
  const Box box = bounding_box(cage.mesh.points), model = bounding_box(car.points);
  EXPECT_NEAR(box.max[1], model.max[1] + 0.1, 1e-15);
  EXPECT_NEAR(box.min[1], -box.max[1], 1e-15);
  EXPECT_LT(box.min[1], model.min[1] - 0.1);
}

TEST(CageAround, BoxesAreNoImagesWhereTheyCannotBe) {
  const Mesh car = ahmed_body({.target_points = 2000}), ball = test::sphere(1, 4);
  const auto expect_same = [](const CageAround& cage, const CageAround& other) {
    EXPECT_EQ(cage.mesh.points, other.mesh.points);
    EXPECT_EQ(cage.mesh.face_points, other.mesh.face_points);
  };
  // Turned, so that no axis is across the plane.
  Mesh turned = car;
  for (Vec3& x : turned.points) x = {0.8 * x[0] - 0.6 * x[1], 0.6 * x[0] + 0.8 * x[1], x[2]};
  const CageAround askew = cage_around(turned, {.kind = CageKind::box, .points = 98});
  EXPECT_TRUE(askew.planes.empty());
  EXPECT_EQ(askew.without.size(), 1u);
  expect_same(askew, cage_around(turned, {.kind = CageKind::box, .points = 98, .symmetry_tolerance = 0}));
  // Not wanted, or not so symmetric.
  const CageAround plain = cage_around(car, {.kind = CageKind::box, .points = 98, .symmetry_tolerance = 0});
  EXPECT_TRUE(plain.planes.empty() && plain.without.empty());
  Mesh bumped = car;
  for (Vec3& x : bumped.points) x[1] += distance(x, {0.5, 0.2, 0.2}) < 0.1 ? 0.02 : 0.0;
  const CageAround usual = cage_around(bumped, {.kind = CageKind::box, .points = 98});
  EXPECT_TRUE(usual.planes.empty() && usual.without.empty());
  expect_same(usual, cage_around(bumped, {.kind = CageKind::box, .points = 98, .symmetry_tolerance = 0}));
  // A cube of one rectangle along each axis has a diagonal in each.
  const CageAround few = cage_around(ball, {.kind = CageKind::box, .points = 8});
  EXPECT_EQ(few.without.size(), 3u);
  // Two along one axis are 12 points.
  const CageAround fewer = cage_around(ball, {.kind = CageKind::box, .points = 12});
  ASSERT_EQ(fewer.planes.size(), 1u);
  EXPECT_EQ(fewer.without.size(), 2u);
  expect_own_image(fewer.mesh, fewer.planes[0]);
  // It ends on one side of a plane.
  CageRequest ending{.kind = CageKind::box, .points = 98, .offset = 0.2};
  ending.lowest[2] = -1;
  const CageAround ended = cage_around(ball, ending);
  EXPECT_EQ(ended.planes.size(), 2u);
  for (const CagePlane& plane : ended.planes) {
    EXPECT_EQ(plane.normal[2], 0);
    expect_own_image(ended.mesh, plane);
  }
  EXPECT_EQ(bounding_box(ended.mesh.points).min[2], -1);
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
  for (const double tolerance : {-1e-3, 0.11, static_cast<double>(NAN)}) {
    expect_error(ErrorCode::invalid_argument, {"symmetry_tolerance", "0 to 0.1"},
                 [&] { (void)cage_around(ball, {.symmetry_tolerance = tolerance}); });
  }
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
}  // namespace deform::cage_around_test
