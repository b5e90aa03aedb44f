// SPDX-License-Identifier: GPL-3.0-or-later
// Faces that are folded over, against what is known without looking at angles: the signed areas of motions in a plane.
#include "core/quality/flipped_faces.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "core/base/vectors.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::flipped_faces_test {
namespace {

using test::add_face;
using test::Faces;
using test::sheet;

constexpr double pi = std::numbers::pi;
using Ids = std::vector<std::size_t>;

Ids sorted_ids(const std::vector<Extreme>& flipped) {
  Ids ids;
  for (const Extreme& face : flipped) ids.push_back(face.id);
  std::sort(ids.begin(), ids.end());
  return ids;
}

Ids flipped_ids(const Mesh& rest, const Points& points) { return sorted_ids(FlipCheck(rest, rest.points).flipped(points)); }

/// Twice the signed area in the plane of x and y.
double area_in_plane(const Mesh& mesh, const Points& points, std::size_t first, std::size_t size) {
  double area = 0;
  for (std::size_t c = 0; c < size; ++c) {
    const Vec3 &p = points[mesh.face_points[first + c]], &q = points[mesh.face_points[first + (c + 1) % size]];
    area += p[0] * q[1] - p[1] * q[0];
  }
  return area;
}

/// The faces of a plane sheet that moved in its plane which lie the wrong way round.
Ids wrong_way_round(const Mesh& rest, const Points& points) {
  Ids ids;
  std::size_t first = 0;
  for (std::size_t f = 0; f < rest.face_count(); ++f) {
    const std::size_t size = rest.face_sizes[f];
    if (area_in_plane(rest, points, first, size) < -1e-12 && area_in_plane(rest, rest.points, first, size) > 0) ids.push_back(f);
    first += size;
  }
  return ids;
}

/// The faces of such a sheet that have no area left.
Ids collapsed(const Mesh& rest, const Points& points) {
  Ids ids;
  std::size_t first = 0;
  for (std::size_t f = 0; f < rest.face_count(); first += rest.face_sizes[f++]) {
    if (std::abs(area_in_plane(rest, points, first, rest.face_sizes[f])) < 1e-12) ids.push_back(f);
  }
  return ids;
}

template <typename Map>
Points mapped(const Points& points, const Map& map) {
  Points result;
  for (const Vec3& p : points) result.push_back(map(p));
  return result;
}

/// About an axis that is none of the coordinate's.
Vec3 rotated(const Vec3& p, double angle, const Vec3& centre = {}) {
  const Vec3 axis{2.0 / 7, 3.0 / 7, 6.0 / 7}, x{p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]};
  const double c = std::cos(angle), s = std::sin(angle);
  const double along = (1 - c) * (axis[0] * x[0] + axis[1] * x[1] + axis[2] * x[2]);
  Vec3 r;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
    r[k] = c * x[k] + s * (axis[i] * x[j] - axis[j] * x[i]) + along * axis[k] + centre[k];
  }
  return r;
}

Mesh unit_sheet(std::uint32_t n, Faces faces) {
  return sheet(n, n, faces, [n](std::uint32_t i, std::uint32_t j) { return Vec3{double(i) / n, double(j) / n, 0}; });
}

/// Goes back between 0.4 and 0.6.
double folded(double x) { return x < 0.4 ? x : x < 0.6 ? 0.8 - x : x - 0.4; }

const Faces both_kinds[] = {Faces::quads, Faces::triangles};

TEST(FlippedFaces, TheStripThatGoesBackAtAnyResolution) {
  for (const Faces faces : both_kinds) {
    for (const std::uint32_t n : {5u, 10u, 20u, 25u, 80u}) {  // the creases are columns of points
      const Mesh rest = unit_sheet(n, faces);
      const Points points = mapped(rest.points, [](const Vec3& p) { return Vec3{folded(p[0]), p[1], p[2]}; });
      const Ids expected = wrong_way_round(rest, points);
      EXPECT_EQ(expected.size(), n * n / 5 * (faces == Faces::quads ? 1 : 2));
      EXPECT_EQ(flipped_ids(rest, points), expected) << n;
      const auto flipped = FlipCheck(rest, rest.points).flipped(points);
      for (const Extreme& face : flipped) EXPECT_NEAR(face.value, -1, 1e-6);
    }
  }
}

TEST(FlippedFaces, LensesThatEndWithinTheSheet) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> some(0, 1);
  std::size_t flipped = 0, all = 0;
  for (int k = 0; k < 60; ++k) {
    const Mesh rest = unit_sheet(12u + static_cast<std::uint32_t>(some(random) * 40), both_kinds[k % 2]);
    const double cx = some(random), cy = some(random), size = 0.05 + 0.2 * some(random), push = 3 * size * some(random);
    const double direction = 2 * pi * some(random);
    const Points points = mapped(rest.points, [&](const Vec3& p) {
      const double bump = push * std::exp(-(std::pow(p[0] - cx, 2) + std::pow(p[1] - cy, 2)) / (size * size));
      return Vec3{p[0] + bump * std::cos(direction), p[1] + bump * std::sin(direction), 0};
    });
    const Ids expected = wrong_way_round(rest, points);
    EXPECT_EQ(flipped_ids(rest, points), expected) << k;
    flipped += expected.size();
    all += rest.face_count();
  }
  EXPECT_GT(flipped, all / 100);
  EXPECT_LT(flipped, all / 2);
}

/// The curve at distance s along it that is straight up to `start`, then bends by `angle` over `length`, then is straight again.
Vec3 bent(const Vec3& p, double start, double length, double angle) {
  if (p[0] <= start) return p;
  const double s = std::min(p[0] - start, length), turned = angle * s / length, radius = length / angle;
  const double beyond = p[0] - start - s;
  return {start + radius * std::sin(turned) + beyond * std::cos(turned), p[1],
          p[2] + radius * (1 - std::cos(turned)) + beyond * std::sin(turned)};
}

TEST(FlippedFaces, NoneInASmoothBend) {
  for (const Faces faces : both_kinds) {
    for (const std::uint32_t n : {10u, 40u, 100u}) {
      const Mesh rest = unit_sheet(n, faces);
      for (const double angle : {pi / 2, pi, 2 * pi}) {
        const auto bend = [&](const Vec3& p) { return bent(p, 0.2, 0.5, n == 10 ? std::min(angle, pi) : angle); };
        EXPECT_EQ(flipped_ids(rest, mapped(rest.points, bend)), Ids{}) << n << " " << angle;
      }
    }
  }
}

TEST(FlippedFaces, NoneWhereAPartTurnsAsAWhole) {
  for (const Faces faces : both_kinds) {
    const Mesh rest = unit_sheet(20, faces);
    for (const double degrees : {40.0, 89.0, 100.0, 119.0}) {
      const double angle = degrees * pi / 180;
      EXPECT_EQ(flipped_ids(rest, mapped(rest.points, [&](const Vec3& p) { return bent(p, 0.5, 1e-12, angle); })), Ids{})
          << degrees << ": a hinge at one row of edges";
      EXPECT_EQ(flipped_ids(rest, mapped(rest.points, [&](const Vec3& p) { return bent(p, 0.5, 0.15, angle); })), Ids{})
          << degrees << ": a transition over three rows";
      const auto lid = [&](const Vec3& p) { return bent(p, 0.95, 1e-12, angle); };
      EXPECT_EQ(flipped_ids(rest, mapped(rest.points, lid)), Ids{}) << degrees << ": one row of faces";
    }
    for (const double angle : {pi, 2.0, 0.3}) {
      EXPECT_EQ(flipped_ids(rest, mapped(rest.points, [&](const Vec3& p) { return rotated(p, angle); })), Ids{}) << angle;
    }
    EXPECT_EQ(flipped_ids(rest, rest.points), Ids{});
  }
}

TEST(FlippedFaces, ALidThatClosesOnTheSheet) {
  const Mesh rest = unit_sheet(10, Faces::quads);
  const auto flipped = flipped_ids(rest, mapped(rest.points, [](const Vec3& p) { return bent(p, 0.7, 1e-12, 0.98 * pi); }));
  ASSERT_EQ(flipped.size(), 30u) << "the smaller part";
  for (const std::size_t f : flipped) EXPECT_GE(f % 10, 7u);
}

TEST(FlippedFaces, WhatStaysIsUprightHoweverSmall) {
  for (const Faces faces : both_kinds) {
    const Mesh rest = unit_sheet(20, faces);
    const auto lid = mapped(rest.points, [](const Vec3& p) { return bent(p, 0.2, 1e-12, 0.98 * pi); });
    for (const std::size_t f : flipped_ids(rest, lid)) EXPECT_GE(f / (faces == Faces::quads ? 1 : 2) % 20, 4u);
    EXPECT_EQ(flipped_ids(rest, lid).size(), rest.face_count() * 4 / 5) << "the larger part";

    // In the plane, with what a solver leaves at fixed points: a strip of a tenth stays, the rest is mirrored over it.
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> some(-1, 1);
    for (const double left : {0.0, 1e-9, 3e-7, 1e-4}) {
      const Points points = mapped(rest.points, [&](const Vec3& p) {
        return p[0] > 0.1 + 1e-9 ? Vec3{0.2 - p[0], p[1], 0} : Vec3{p[0] + left * some(random), p[1] + left * some(random), 0};
      });
      const Ids mirrored = wrong_way_round(rest, points);
      ASSERT_EQ(mirrored.size(), rest.face_count() * 9 / 10);
      Ids others(rest.face_count());
      std::iota(others.begin(), others.end(), std::size_t{0});
      std::erase_if(others, [&](std::size_t f) { return std::binary_search(mirrored.begin(), mirrored.end(), f); });
      EXPECT_EQ(flipped_ids(rest, points), left < 1e-6 ? mirrored : others) << left << ": only what moves can be turned over";
    }
  }
}

TEST(FlippedFaces, OnePointFarAwayDoesNotMakeOthersStay) {
  // Compared with that one a strip hardly moved, and yet it did: the larger part is upright, which is mirrored over it.
  const Mesh rest = unit_sheet(20, Faces::quads);
  Points points = mapped(rest.points, [](const Vec3& p) { return Vec3{p[0] < 0.3 ? p[0] : 0.6 - p[0], p[1], 1e-3}; });
  points.back() = {-1e4, 1e4, 1e-3};
  const Ids flipped = flipped_ids(rest, points);
  for (std::size_t f = 0; f < 399; ++f) {
    EXPECT_EQ(std::binary_search(flipped.begin(), flipped.end(), f), f % 20 < 6) << f << ": the strip is the smaller part";
  }
}

TEST(FlippedFaces, BothEndsThatStayAreUprightWhateverIsBetween) {
  // A ring in the middle of a tube turns across it and moves aside. The creases between the ring and the ends make these look as
  // if one of them were upside down.
  const Mesh tube = test::tube(1, 40, 100, 10, Faces::quads);
  for (const double degrees : {110.0, 125.0, 140.0}) {
    const double c = std::cos(degrees * pi / 180), s = std::sin(degrees * pi / 180);
    std::vector<double> moved;
    const Points points = mapped(tube.points, [&](const Vec3& p) {
      const double t = std::clamp(std::abs(p[2] - 5) - 0.3, 0.0, 1.0), w = (1 - t) * (1 - t) * (1 + 2 * t);
      const Vec3 turned{c * p[0] + s * (p[2] - 5) + 1, p[1], 5 - s * p[0] + c * (p[2] - 5)};
      moved.push_back(w * std::hypot(turned[0] - p[0], turned[2] - p[2]));
      return Vec3{p[0] + w * (turned[0] - p[0]), p[1], p[2] + w * (turned[2] - p[2])};
    });
    const Ids flipped = flipped_ids(tube, points);
    EXPECT_GT(flipped.size(), 0u) << degrees;
    for (const std::size_t f : flipped) EXPECT_GT(moved[tube.face_points[4 * f]], 0.2) << degrees << " " << f;
  }
}

TEST(FlippedFaces, AFaceThatStaysIsNotFlippedByItsNeighbours) {
  // A triangle with three flaps that turn by 100 degrees: those moved.
  Mesh rest;
  const double h = std::sqrt(3) / 2;
  rest.points = {{0, 0, 0}, {1, 0, 0}, {0.5, h, 0}, {0.5, -h, 0}, {1.5, h, 0}, {-0.5, h, 0}};
  add_face(rest, {0, 1, 2});
  add_face(rest, {1, 0, 3});
  add_face(rest, {2, 1, 4});
  add_face(rest, {0, 2, 5});
  Points points = rest.points;
  for (std::size_t p = 3; p < 6; ++p) {
    const Vec3 middle{0.5, h / 3, 0};
    for (std::size_t k = 0; k < 2; ++k) {
      const double hinge = middle[k] + (rest.points[p][k] - middle[k]) / 4;  // the middle of the edge
      points[p][k] = hinge + (rest.points[p][k] - hinge) * std::cos(1.75);
    }
    points[p][2] = -h * std::sin(1.75);
  }
  EXPECT_EQ(flipped_ids(rest, points), Ids{});
  for (Vec3& p : points) p[2] += 0.5;
  EXPECT_EQ(flipped_ids(rest, points), Ids{0}) << "all moved";
}

TEST(FlippedFaces, TheMiddleOfAZ) {
  for (const Faces faces : both_kinds) {
    for (const std::uint32_t n : {10u, 30u}) {
      const Mesh rest = unit_sheet(n, faces);
      const Points points = mapped(rest.points, [](const Vec3& p) {  // with some air between the layers
        return Vec3{folded(p[0]), p[1], p[0] < 0.4 ? 0 : p[0] < 0.6 ? 0.1 * (p[0] - 0.4) : 0.02};
      });
      EXPECT_EQ(flipped_ids(rest, points), wrong_way_round(rest, points));
      EXPECT_GT(flipped_ids(rest, points).size(), 0u);
    }
  }
}

TEST(FlippedFaces, CreasesAreSeenThatAreRoundAtThisResolution) {
  // Along the sheet, and a little up: the normals turn over some rows of faces, which are crushed.
  for (const std::uint32_t n : {30u, 60u, 120u, 240u}) {
    const Mesh rest = unit_sheet(n, both_kinds[n / 60 % 2]);
    for (const double slope : {0.005, 0.02, 0.05}) {
      const Points points = mapped(rest.points, [&](const Vec3& p) {
        const double bump = 0.4 * std::exp(-(std::pow(p[0] - 0.5, 2) + std::pow(p[1] - 0.4, 2)) / 0.03);
        return Vec3{p[0] + bump, p[1], slope * bump};
      });
      const double expected = static_cast<double>(wrong_way_round(rest, points).size());
      EXPECT_NEAR(static_cast<double>(flipped_ids(rest, points).size()), expected, 0.05 * expected + 2) << n << " " << slope;
    }
  }
}

TEST(FlippedFaces, NoneWhereFacesAreOnlyCrushed) {
  const Mesh ball = test::sphere(1, 4);
  for (const double height : {0.6, 0.4, 0.1, 0.001}) {
    const auto squashed = mapped(ball.points, [&](const Vec3& p) { return Vec3{p[0], p[1] + p[2], height * p[2]}; });
    EXPECT_EQ(flipped_ids(ball, mapped(squashed, [](const Vec3& p) { return rotated(p, 2.5); })), Ids{}) << height;
  }
  // A tube squeezed between two rings that stay, and one that is twisted.
  const Mesh tube = test::tube(1, 40, 60, 3, Faces::triangles);
  for (const double least : {0.3, 0.05}) {
    const auto squeezed = mapped(tube.points, [&](const Vec3& p) {
      const double z = p[2] < 1 ? p[2] : p[2] < 2 ? 1 + least * (p[2] - 1) : p[2] - 1 + least;
      return Vec3{p[0], p[1], z};
    });
    EXPECT_EQ(flipped_ids(tube, mapped(squeezed, [](const Vec3& p) { return rotated(p, 1.3); })), Ids{}) << least;
  }
  EXPECT_EQ(flipped_ids(tube, mapped(tube.points,
                                     [](const Vec3& p) {
                                       const double c = std::cos(1.5 * p[2]), s = std::sin(1.5 * p[2]);
                                       return Vec3{c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]};
                                     })),
            Ids{});
}

TEST(FlippedFaces, OneTriangleOfATurnedMesh) {
  Mesh rest = unit_sheet(6, Faces::triangles);
  // A point within the first of the triangles of face 30: the third of its parts flips when the point leaves it.
  const std::size_t split = 30;
  const PointId a = rest.face_points[3 * split], b = rest.face_points[3 * split + 1], c = rest.face_points[3 * split + 2];
  const auto d = static_cast<PointId>(rest.point_count());
  Vec3 middle, outside;
  for (std::size_t k = 0; k < 3; ++k) {
    middle[k] = (rest.points[a][k] + rest.points[b][k] + rest.points[c][k]) / 3;
    outside[k] = 0.5 * rest.points[a][k] + 0.6 * rest.points[b][k] - 0.1 * rest.points[c][k];
  }
  rest.points.push_back(middle);
  rest.face_points[3 * split + 2] = d;
  add_face(rest, {b, c, d});
  add_face(rest, {c, a, d});
  for (const double angle : {0.0, 0.4, 2.0, pi}) {
    Points points = rest.points;
    points[d] = outside;
    EXPECT_EQ(flipped_ids(rest, mapped(points, [&](const Vec3& p) { return rotated(p, angle); })), Ids{split}) << angle;
  }
  // At the corner of the sheet: with one neighbour.
  Points points = rest.points;
  points[6] = {0.7, 0.3, 0};
  EXPECT_EQ(flipped_ids(rest, points), wrong_way_round(rest, points));
}

TEST(FlippedFaces, ASpikeBeyondNinetyDegrees) {
  // A triangle amid others whose normal turns by 100 degrees: no edge is folded over, and yet it looks the wrong way.
  Mesh rest;
  const double h = std::sqrt(3) / 2;
  rest.points = {{0, 0, 0}, {1, 0, 0}, {0.5, h, 0}, {0.5, -2 * h, 0}, {2, 2 * h, 0}, {-1, 2 * h, 0}};
  add_face(rest, {0, 1, 2});
  add_face(rest, {1, 0, 3});
  add_face(rest, {2, 1, 4});
  add_face(rest, {0, 2, 5});
  Points points = rest.points;
  const double low = -0.6;
  points[2] = {0.5, h * std::cos(1.75), low};  // about the edge 0 1
  points[4] = {2, 0.2, low};
  points[5] = {-1, 0.2, low};
  const auto flipped = FlipCheck(rest, rest.points).flipped(points);
  for (const Extreme& face : flipped) EXPECT_LT(face.value, 0);
}

/// A square tube along z in `rows` of quads, `columns` a side.
Mesh square_tube(std::uint32_t columns, std::uint32_t rows) {
  Mesh mesh = test::tube(1, 4 * columns, rows, 1, Faces::quads);
  for (std::uint32_t j = 0; j <= rows; ++j) {
    for (std::uint32_t i = 0; i < 4 * columns; ++i) {
      const double t = double(i % columns) / columns;
      const Vec3 at[] = {{t, 0, 0}, {1, t, 0}, {1 - t, 1, 0}, {0, 1 - t, 0}};
      mesh.points[i + 4 * columns * j] = {at[i / columns][0], at[i / columns][1], double(j) / rows};
    }
  }
  return mesh;
}

TEST(FlippedFaces, BandsThatGoRoundSharpEdges) {
  // Along the edges of the tube the faces of the band are mirrored together: to each other they look as if one were inside out.
  for (const std::uint32_t columns : {2u, 5u, 12u}) {
    const Mesh rest = square_tube(columns, 20);
    const Points points = mapped(rest.points, [](const Vec3& p) { return Vec3{p[0], p[1], folded(p[2])}; });
    Ids expected(4 * columns * 4);
    std::iota(expected.begin(), expected.end(), 4 * columns * 8);
    EXPECT_EQ(flipped_ids(rest, points), expected) << columns;
  }
}

TEST(FlippedFaces, OrderOfFacesRotationsAndThreadsDoNotMatter) {
  Mesh rest = unit_sheet(30, Faces::triangles);
  for (Vec3& p : rest.points) p[2] = 0.01 * std::sin(9 * p[0]) * std::cos(7 * p[1]);
  const Points points = mapped(rest.points, [](const Vec3& p) {
    const double bump = 0.4 * std::exp(-(std::pow(p[0] - 0.5, 2) + std::pow(p[1] - 0.4, 2)) / 0.03);
    return Vec3{p[0] + bump, p[1], p[2] + 0.02 * bump};
  });
  RunContext one, four;
  one.threads = 1;
  four.threads = 4;
  const FlipCheck check(rest, rest.points);
  const auto flipped = check.flipped(points, one);
  ASSERT_GT(flipped.size(), 20u);
  for (std::size_t k = 1; k < flipped.size(); ++k) EXPECT_LE(flipped[k - 1].value, flipped[k].value) << "worst first";
  const auto again = check.flipped(points, four);
  ASSERT_EQ(again.size(), flipped.size());
  for (std::size_t k = 0; k < flipped.size(); ++k)
    EXPECT_TRUE(again[k].id == flipped[k].id && again[k].value == flipped[k].value);

  const auto turn = [](const Vec3& p) { return rotated(p, 2.2, {5, 4, 3}); };
  Mesh turned = rest;
  turned.points = mapped(rest.points, turn);
  EXPECT_EQ(flipped_ids(turned, mapped(points, turn)), sorted_ids(flipped)) << "both states turned";
  EXPECT_EQ(flipped_ids(rest, mapped(points, turn)), sorted_ids(flipped)) << "the deformed one";

  std::vector<std::size_t> order(rest.face_count());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::shuffle(order.begin(), order.end(), std::mt19937_64(5));
  Mesh shuffled = rest;
  for (std::size_t f = 0; f < order.size(); ++f) {
    for (std::size_t c = 0; c < 3; ++c) shuffled.face_points[3 * f + c] = rest.face_points[3 * order[f] + c];
  }
  Ids same;
  for (const std::size_t f : flipped_ids(shuffled, points)) same.push_back(order[f]);
  std::sort(same.begin(), same.end());
  EXPECT_EQ(same, sorted_ids(flipped));
}

TEST(FlippedFaces, WindingsThatDisagreeAtRest) {
  Mesh rest = unit_sheet(15, Faces::triangles);
  const Points points = mapped(rest.points, [](const Vec3& p) { return Vec3{folded(p[0]), p[1], p[2]}; });
  const Ids expected = wrong_way_round(rest, points);
  std::mt19937_64 random(9);
  for (std::size_t f = 0; f < rest.face_count(); ++f) {
    if (random() % 2 == 0) std::swap(rest.face_points[3 * f], rest.face_points[3 * f + 1]);
  }
  EXPECT_EQ(flipped_ids(rest, rest.points), Ids{});
  EXPECT_EQ(flipped_ids(rest, points), expected);
}

TEST(FlippedFaces, PartsAreJudgedOneByOne) {
  Mesh rest = unit_sheet(10, Faces::quads);
  const Mesh other = unit_sheet(10, Faces::triangles);
  const auto shift = static_cast<PointId>(rest.point_count());
  for (const Vec3& p : other.points) rest.points.push_back({p[0] + 2, p[1], p[2]});
  rest.face_sizes.insert(rest.face_sizes.end(), other.face_sizes.begin(), other.face_sizes.end());
  for (const PointId p : other.face_points) rest.face_points.push_back(p + shift);
  // The first turns over as a whole, the second folds.
  const Points points = mapped(rest.points, [](const Vec3& p) {
    return p[0] <= 1 ? Vec3{1 - p[0], p[1], -p[2]} : Vec3{2 + folded(p[0] - 2), p[1], p[2]};
  });
  Ids expected = wrong_way_round(rest, points);
  std::erase_if(expected, [](std::size_t f) { return f < 100; });
  EXPECT_EQ(expected.size(), 40u);
  EXPECT_EQ(flipped_ids(rest, points), expected);
}

TEST(FlippedFaces, CollapsedFacesCountAndWhatIsBeyondThemIsSeen) {
  for (const Faces faces : both_kinds) {
    const Mesh rest = unit_sheet(25, faces);
    const auto flat = [](double x) { return x < 0.4 ? x : x < 0.48 ? 0.4 : x < 0.6 ? 0.88 - x : x < 0.68 ? 0.28 : x - 0.4; };
    const Points points = mapped(rest.points, [&](const Vec3& p) { return Vec3{flat(p[0]), p[1], p[2]}; });
    Ids expected = wrong_way_round(rest, points);
    EXPECT_EQ(expected.size(), 25u * 3 * (faces == Faces::quads ? 1 : 2));
    const Ids creases = collapsed(rest, points);
    EXPECT_EQ(creases.size(), 25u * 4 * (faces == Faces::quads ? 1 : 2));
    expected.insert(expected.end(), creases.begin(), creases.end());
    std::sort(expected.begin(), expected.end());
    EXPECT_EQ(flipped_ids(rest, points), expected);
    EXPECT_EQ(flipped_ids(rest, mapped(rest.points, [](const Vec3&) { return Vec3{}; })).size(), rest.face_count()) << "a point";
    EXPECT_EQ(flipped_ids(rest, mapped(rest.points, [](const Vec3& p) { return Vec3{p[0], 0, 0}; })).size(), rest.face_count());
  }
}

TEST(FlippedFaces, FacesWithoutAreaAtRestTakeNoPart) {
  Mesh rest = unit_sheet(10, Faces::triangles);
  add_face(rest, {3, 3, 4});
  add_face(rest, {0, 1, 2});  // on one line
  add_face(rest, {7, 8});
  rest.points.push_back({5, 5, 5});
  Points points = mapped(rest.points, [](const Vec3& p) { return Vec3{folded(p[0]), p[1], p[2]}; });
  points[1][1] = -0.05;
  EXPECT_EQ(flipped_ids(rest, points), wrong_way_round(rest, points));
}

TEST(FlippedFaces, WhereThreeSheetsMeet) {
  // A fin on a sheet, along a row of points; the sheet folds beside it, the fin turns with it.
  Mesh rest = unit_sheet(10, Faces::quads);
  for (std::uint32_t j = 0; j <= 10; ++j) rest.points.push_back({0.2, j / 10.0, 0.3});
  for (std::uint32_t j = 0; j < 10; ++j) add_face(rest, {2 + 11 * j, 2 + 11 * (j + 1), 122 + j, 121 + j});
  const Points points = mapped(rest.points, [](const Vec3& p) { return Vec3{folded(p[0]), p[1], p[2]}; });
  Ids expected;
  for (std::size_t f = 0; f < 100; ++f) {
    if (f % 10 == 4 || f % 10 == 5) expected.push_back(f);
  }
  EXPECT_EQ(flipped_ids(rest, points), expected);
}

/// Far from the origin a face of no width has an area of rounding, whose direction means nothing.
TEST(FlippedFaces, FacesOfNoWidthAreIgnoredFarFromTheOriginToo) {
  for (const double away : {0.0, 5e4}) {
    Mesh rest = unit_sheet(6, Faces::quads);
    for (Vec3& p : rest.points) p = p + Vec3{away, away, away};
    // On the edge of the first face, up to rounding: its corners are 0, 1, 8 and 7.
    const auto middle = static_cast<PointId>(rest.points.size());
    const double width = away == 0 ? 1e-11 : 4 * (std::nextafter(away, HUGE_VAL) - away);
    rest.points.push_back(0.5 * (rest.points[0] + rest.points[1]) - Vec3{0, width, 0});
    add_face(rest, {0, middle, 1});
    Points moved = rest.points;
    moved[middle][1] += 2 * width;
    EXPECT_EQ(flipped_ids(rest, moved), away == 0 ? Ids{36} : Ids{}) << away;
  }
}

TEST(FlippedFaces, RefusesOtherNumbersOfPointsAndBearsAnything) {
  const Mesh rest = unit_sheet(4, Faces::quads);
  const FlipCheck check(rest, rest.points);
  EXPECT_EQ(check.face_count(), 16u);
  EXPECT_LE(check.bytes(), FlipCheck::bytes_for(rest));
  const Mesh large = unit_sheet(40, Faces::quads);
  EXPECT_LE(FlipCheck::bytes_for(large), 4 * FlipCheck(large, large.points).bytes()) << "for edges of four faces, these have two";
  test::expect_error(ErrorCode::invalid_argument, {"24", "25"}, [&] { check.flipped(Points(24)); });
  test::expect_error(ErrorCode::invalid_argument, {"7", "25"}, [&] { FlipCheck(rest, Points(7)); });
  Points points = rest.points;
  points[7][0] = std::numeric_limits<double>::quiet_NaN();
  points[12][1] = std::numeric_limits<double>::infinity();
  points[18][1] = 1e300;
  check.flipped(points);
  EXPECT_TRUE(flipped_faces(Mesh{}, {}).empty());
}

}  // namespace
}  // namespace deform::flipped_faces_test
