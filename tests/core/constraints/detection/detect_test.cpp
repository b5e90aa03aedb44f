// SPDX-License-Identifier: GPL-3.0-or-later
// Parts whose planes, cylinders, spheres and cones are known by construction.
#include "core/constraints/detection/detect.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "tests/core/constraints/detection/expect_found.h"
#include "tests/core/constraints/detection/parts.h"

namespace deform::detect_test {
namespace {

using test::expect_found;
using test::Kind;
using test::Part;

/// Normal noise of that standard deviation over the diagonal, in every coordinate.
void shake(Mesh& mesh, double level, unsigned seed) {
  const double deviation = level * bounding_box(mesh.points).diagonal();
  std::mt19937_64 engine(seed);
  std::normal_distribution<double> normal(0, deviation);
  for (Vec3& p : mesh.points) {
    for (double& x : p) x += normal(engine);
  }
}

class Parts : public testing::TestWithParam<int> {};

TEST_P(Parts, AreFoundExactly) {
  for (const Part& part : test::all_parts(GetParam())) {
    expect_found(part, detect(part.mesh, {}), part.name, 1e-6);
  }
}

TEST_P(Parts, AreFoundInNoise) {
  for (Part& part : test::all_parts(GetParam())) {
    shake(part.mesh, 1e-4, 7);
    expect_found(part, detect(part.mesh, {}), part.name, 5e-3);
  }
}

INSTANTIATE_TEST_SUITE_P(Resolutions, Parts, testing::Values(1, 2, 3));

std::vector<std::string> names(const Detection& found) {
  std::vector<std::string> result;
  for (const auto& p : found.primitives) result.push_back(p.name);
  for (const auto& e : found.edges) result.push_back(e.name);
  return result;
}

bool same_bits(const Detection& a, const Detection& b) {
  if (names(a) != names(b)) return false;
  for (std::size_t i = 0; i < a.primitives.size(); ++i) {
    const Primitive &p = a.primitives[i], &q = b.primitives[i];
    if (p.faces != q.faces || p.points != q.points || p.axis != q.axis || p.point != q.point || p.radius != q.radius)
      return false;
  }
  for (std::size_t i = 0; i < a.edges.size(); ++i) {
    if (a.edges[i].points != b.edges[i].points || a.edges[i].radius != b.edges[i].radius) return false;
  }
  return true;
}

TEST(Detect, GivesTheSameForAnyNumberOfThreadsAndTheSameSeed) {
  Part part = test::filleted_shaft(3);
  shake(part.mesh, 1e-4, 3);
  RunContext one, two;
  one.threads = 1;
  two.threads = 2;
  DetectOptions options;
  options.seed = 5;
  const Detection first = detect(part.mesh, options, one);
  EXPECT_TRUE(same_bits(first, detect(part.mesh, options, two)));
  EXPECT_TRUE(same_bits(first, detect(part.mesh, options, one)));
  options.seed = 6;
  EXPECT_EQ(names(detect(part.mesh, options, one)), names(first)) << "another seed finds the same primitives";
}

TEST(Detect, DoesNotDependOnPlaceTurnAndScale) {
  for (const Part& part : test::all_parts(2)) {
    SCOPED_TRACE(part.name);
    Mesh moved = part.mesh;
    const double c = std::cos(0.7), s = std::sin(0.7), k = 1250;
    for (Vec3& p : moved.points) {
      const Vec3 q{c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]};
      p = {k * q[0] + 5000, k * (c * q[1] - s * q[2]) - 300, k * (s * q[1] + c * q[2])};
    }
    const Detection here = detect(part.mesh, {}), there = detect(moved, {});
    // Names say where planes are, and in model units how large the rest is.
    ASSERT_EQ(here.primitives.size(), there.primitives.size());
    ASSERT_EQ(here.edges.size(), there.edges.size());
    for (std::size_t i = 0; i < here.primitives.size(); ++i) {
      const Primitive &p = here.primitives[i], &q = there.primitives[i];
      EXPECT_EQ(p.kind, q.kind) << p.name;
      EXPECT_EQ(p.faces, q.faces) << p.name;
      EXPECT_NEAR(p.radius * k, q.radius, 1e-4) << p.name;
      EXPECT_NEAR(p.area * k * k, q.area, 1e-6 * q.area) << p.name;
    }
  }
}

TEST(Detect, PutsPointsOfSharpEdgesIntoAllTheirPrimitives) {
  const Part part = test::cube(5);
  const Detection found = detect(part.mesh, {});
  ASSERT_EQ(found.primitives.size(), 6u);
  std::vector<int> uses(part.mesh.point_count(), 0);
  for (const Primitive& p : found.primitives) {
    EXPECT_EQ(p.points.size(), 36u);
    EXPECT_LT(p.max, 1e-14);
    for (const PointId id : p.points) ++uses[id];
  }
  for (std::size_t i = 0; i < uses.size(); ++i) {
    int sides = 0;
    for (const double x : part.mesh.points[i]) sides += x == 0 || x == 1 ? 1 : 0;
    EXPECT_EQ(uses[i], sides);
  }
  EXPECT_NEAR(found.coverage, 1, 1e-12);
  EXPECT_NEAR(found.area, 6, 1e-12);
}

/// Distance of a point from a primitive, in model units.
double away_from(const Primitive& p, const Vec3& x) {
  const Vec3 q = x - p.point;
  const double h = dot(q, p.axis), across = norm(q - h * p.axis);
  switch (p.kind) {
    case PrimitiveKind::plane:
      return std::abs(h);
    case PrimitiveKind::sphere:
      return std::abs(norm(q) - p.radius);
    case PrimitiveKind::cylinder:
      return std::abs(across - p.radius);
    case PrimitiveKind::cone:
      break;
  }
  return std::abs(across * std::cos(p.half_angle) - h * std::sin(p.half_angle));
}

TEST(Detect, ReportsErrorsAndAreasOfItsPrimitives) {
  for (Part& part : test::all_parts(2)) {
    shake(part.mesh, 1e-4, 9);
    for (Vec3& p : part.mesh.points) p = 40.0 * p;
    for (const Primitive& p : detect(part.mesh, {}).primitives) {
      SCOPED_TRACE(part.name + " " + p.name);
      double squares = 0, most = 0, area = 0;
      for (const PointId id : p.points) {
        const double d = away_from(p, part.mesh.points[id]);
        squares += d * d;
        most = std::max(most, d);
      }
      EXPECT_NEAR(p.rms, std::sqrt(squares / static_cast<double>(p.points.size())), 1e-9);
      EXPECT_NEAR(p.max, most, 1e-9);
      for (const FaceId f : p.faces) area += test::face_area(part.mesh, f);
      EXPECT_NEAR(p.area, area, 1e-9 * area);
    }
  }
}

/// Distance of a point from a line or circle, in model units.
double away_from(const EdgeFeature& e, const Vec3& x) {
  const Vec3 q = x - e.point;
  const double h = dot(q, e.axis), across = norm(q - h * e.axis);
  return e.kind == EdgeKind::line ? across : std::hypot(across - e.radius, h);
}

TEST(Detect, ReportsErrorsAndLengthsOfItsEdgesInAnyUnit) {
  for (const double unit : {1.0, 1000.0}) {
    std::size_t kinds = 0;
    for (Part part : {test::cube(4), test::plate_with_hole(2), test::rounded_block(2)}) {
      shake(part.mesh, 1e-4, 9);
      for (Vec3& p : part.mesh.points) p = unit * p;
      for (const EdgeFeature& e : detect(part.mesh, {}).edges) {
        SCOPED_TRACE(part.name + " " + e.name);
        kinds |= std::size_t{1} << static_cast<int>(e.kind);
        double squares = 0, most = 0, length = 0;
        for (std::size_t i = 0; i < e.points.size(); ++i) {
          const Vec3& x = part.mesh.points[e.points[i]];
          const double d = away_from(e, x);
          squares += d * d;
          most = std::max(most, d);
          const bool last = i + 1 == e.points.size();
          if (!last || e.kind == EdgeKind::circle) length += distance(x, part.mesh.points[e.points[last ? 0 : i + 1]]);
        }
        EXPECT_NEAR(e.rms, std::sqrt(squares / static_cast<double>(e.points.size())), 1e-9 * unit);
        EXPECT_NEAR(e.max, most, 1e-9 * unit);
        EXPECT_NEAR(e.length, length, 1e-9 * length);
      }
    }
    EXPECT_EQ(kinds, 7u) << "lines, circles and arcs";
  }
}

TEST(Detect, FindsLinesAndCirclesOnSharpEdges) {
  const Detection edges_of_cube = detect(test::cube(4).mesh, {});
  ASSERT_EQ(edges_of_cube.edges.size(), 12u);
  for (const EdgeFeature& e : edges_of_cube.edges) {
    EXPECT_EQ(e.kind, EdgeKind::line);
    EXPECT_EQ(e.points.size(), 5u);
    EXPECT_NEAR(e.length, 1, 1e-12);
  }
  const Detection plate = detect(test::plate_with_hole(2).mesh, {});
  std::size_t circles = 0;
  for (const EdgeFeature& e : plate.edges) {
    EXPECT_NE(e.kind, EdgeKind::arc) << e.name;
    if (e.kind != EdgeKind::circle) continue;
    ++circles;
    EXPECT_EQ(e.points.size(), 32u);
    EXPECT_NEAR(e.radius, 0.5, 1e-9);
    EXPECT_NEAR(std::abs(e.point[2]), 0.3, 1e-9);
    EXPECT_NEAR(std::abs(e.axis[2]), 1, 1e-9);
  }
  EXPECT_EQ(circles, 2u);
  EXPECT_EQ(plate.edges.size(), 14u);
  std::size_t arcs = 0;
  for (const EdgeFeature& e : detect(test::rounded_block(2).mesh, {}).edges) {
    if (e.kind != EdgeKind::arc) continue;
    ++arcs;
    EXPECT_NEAR(e.radius, 0.3, 1e-9);
    EXPECT_EQ(e.points.size(), 13u);
  }
  EXPECT_EQ(arcs, 8u);
}

TEST(Detect, SharpEdgesFollowTheMaximumAngle) {
  DetectOptions options;
  const auto count = [&](int around, PrimitiveKind kind) {
    Part part;
    part.revolve_line(part.truth(Kind::plane), around, 1, 0.5, 0, 0.5, 1);
    const Detection found = detect(part.mesh, options);
    return std::count_if(found.primitives.begin(), found.primitives.end(), [&](const Primitive& p) { return p.kind == kind; });
  };
  EXPECT_EQ(count(16, PrimitiveKind::cylinder), 1);
  EXPECT_EQ(count(16, PrimitiveKind::plane), 0);
  EXPECT_EQ(count(11, PrimitiveKind::cylinder), 1);
  EXPECT_EQ(count(10, PrimitiveKind::plane), 10);
  EXPECT_EQ(count(6, PrimitiveKind::plane), 6);
  options.maximum_angle = 0.3;
  EXPECT_EQ(count(16, PrimitiveKind::plane), 16);
  options.maximum_angle = 0.8;
  EXPECT_EQ(count(8, PrimitiveKind::cylinder), 1);
}

TEST(Detect, LooksForTheKindsThatAreAskedFor) {
  const Part part = test::step_shaft(2);
  DetectOptions options;
  options.kinds = {PrimitiveKind::plane};
  const Detection found = detect(part.mesh, options);
  EXPECT_EQ(found.primitives.size(), 4u);
  for (const Primitive& p : found.primitives) EXPECT_EQ(p.kind, PrimitiveKind::plane);
  options.kinds = {};
  options.minimum_area = 0.2;
  for (const Primitive& p : detect(part.mesh, options).primitives) EXPECT_GE(p.area, 0.2 * found.area);
}

TEST(Detect, TakesWhateverIsAMesh) {
  Part part = test::plate_with_hole(2);
  const std::size_t faces = part.mesh.face_count();
  const Detection clean = detect(part.mesh, {});
  Mesh& mesh = part.mesh;
  mesh.points.push_back({1e6, 0, 0});  // without faces
  const auto far = static_cast<PointId>(mesh.points.size() - 1);
  mesh.points.push_back(mesh.points[0]);  // coincident
  // A face that repeats a corner, two corners, one corner; a fin on an edge that has two faces already.
  for (const std::vector<PointId>& face : std::vector<std::vector<PointId>>{{0, 1, 1}, {0, 1}, {2}}) {
    mesh.face_sizes.push_back(static_cast<std::uint32_t>(face.size()));
    mesh.face_points.insert(mesh.face_points.end(), face.begin(), face.end());
  }
  mesh.points.push_back({2, 2, 0.1});
  mesh.face_sizes.push_back(3);
  mesh.face_points.insert(mesh.face_points.end(), {far + 1, 1, far + 2});
  const Detection found = detect(mesh, {});
  ASSERT_EQ(names(found).size() >= clean.primitives.size(), true);
  ASSERT_EQ(found.primitives.size(), clean.primitives.size());
  for (std::size_t i = 0; i < clean.primitives.size(); ++i) {
    std::vector<FaceId> old = found.primitives[i].faces;
    std::erase_if(old, [&](FaceId f) { return f >= faces; });
    EXPECT_EQ(old, clean.primitives[i].faces) << clean.primitives[i].name;
  }
  ASSERT_FALSE(found.notes.empty());
}

TEST(Detect, JoinsCoincidentPointsAndTurnsFacesAround) {
  const Part part = test::capped_cylinder(2);
  Mesh soup;  // every triangle has points of its own, every third is turned around
  for (std::size_t f = 0; f < part.mesh.face_count(); ++f) {
    soup.face_sizes.push_back(3);
    for (std::size_t k = 0; k < 3; ++k) {
      soup.face_points.push_back(static_cast<PointId>(soup.points.size()));
      soup.points.push_back(part.mesh.points[part.mesh.face_points[3 * f + (f % 3 == 0 ? 2 - k : k)]]);
    }
  }
  const Detection whole = detect(part.mesh, {}), apart = detect(soup, {});
  ASSERT_EQ(names(whole), names(apart));
  for (std::size_t i = 0; i < whole.primitives.size(); ++i) EXPECT_EQ(whole.primitives[i].faces, apart.primitives[i].faces);
}

TEST(Detect, KnowsPolygons) {
  // The hexagonal prism with caps of one face each, and a cylinder of 24 quads with two polygons.
  for (const std::uint32_t sides : {6u, 24u}) {
    Mesh mesh;
    for (const double z : {0.0, 1.0}) {
      for (std::uint32_t i = 0; i < sides; ++i) {
        const double angle = 2 * std::numbers::pi * i / sides;
        mesh.points.push_back({std::cos(angle), std::sin(angle), z});
      }
    }
    for (std::uint32_t i = 0; i < sides; ++i) {
      mesh.face_sizes.push_back(4);
      mesh.face_points.insert(mesh.face_points.end(), {i, (i + 1) % sides, sides + (i + 1) % sides, sides + i});
    }
    mesh.face_sizes.insert(mesh.face_sizes.end(), {sides, sides});
    for (std::uint32_t i = 0; i < sides; ++i) mesh.face_points.push_back(sides - 1 - i);
    for (std::uint32_t i = 0; i < sides; ++i) mesh.face_points.push_back(sides + i);
    const Detection found = detect(mesh, {});
    EXPECT_EQ(found.primitives.size(), sides == 6 ? 8u : 3u);
    if (sides == 24) {
      EXPECT_NEAR(found.primitives[2].radius, 1, 1e-9);
    }
  }
}

TEST(Detect, KeepsBoresBehindEachOtherApartAndJoinsHalves) {
  Part apart;  // two tubes on one axis
  const int label = apart.truth(Kind::cylinder, 0.5);
  apart.revolve_line(label, 32, 4, 0.5, 0, 0.5, 1);
  apart.revolve_line(label, 32, 4, 0.5, 2, 0.5, 3);
  EXPECT_EQ(detect(apart.mesh, {}).primitives.size(), 2u);
  Part halves;  // one tube, slit on two sides
  for (const int first : {0, 16}) {
    halves.sheet(0, 14, 8, [&](int i, int j) -> Vec3 {
      const double angle = 2 * std::numbers::pi * (first + i) / 32;
      return {0.5 * std::cos(angle), 0.5 * std::sin(angle), j / 8.0};
    });
  }
  const Detection found = detect(halves.mesh, {});
  ASSERT_EQ(found.primitives.size(), 1u);
  EXPECT_EQ(found.primitives[0].faces.size(), halves.mesh.face_count());
}

TEST(Detect, RefusesBadOptionsAndEmptyMeshes) {
  const Mesh mesh = test::cube(1).mesh;
  const auto message = [&](const DetectOptions& options, const Mesh& tested) -> std::string {
    try {
      detect(tested, options);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::invalid_argument);
      return error.what();
    }
    return "none";
  };
  DetectOptions options;
  options.tolerance = -1;
  EXPECT_THAT(message(options, mesh), testing::HasSubstr("detection.tolerance: -1"));
  options = {};
  options.minimum_area = 1;
  EXPECT_THAT(message(options, mesh), testing::HasSubstr("detection.minimum_area: 1"));
  options = {};
  options.maximum_angle = std::nan("");
  EXPECT_THAT(message(options, mesh), testing::HasSubstr("detection.maximum_angle"));
  EXPECT_THAT(message({}, Mesh{}), testing::HasSubstr("no face with an area"));
  RunContext stopped;
  std::stop_source stop;
  stopped.stop = stop.get_token();
  stop.request_stop();
  EXPECT_THROW(detect(mesh, {}, stopped), Error);
}

TEST(Colours, Differ) {
  const auto colours = distinct_colours(24);
  ASSERT_EQ(colours.size(), 24u);
  EXPECT_EQ(colours, distinct_colours(24));
  for (std::size_t a = 0; a < colours.size(); ++a) {
    const auto [least, most] = std::minmax_element(colours[a].begin(), colours[a].end());
    EXPECT_GT(*most - *least, 60) << "no grey";
    for (std::size_t b = a + 1; b < colours.size(); ++b) {
      int distance = 0;
      for (std::size_t k = 0; k < 3; ++k) distance += std::abs(colours[a][k] - colours[b][k]);
      EXPECT_GT(distance, 25) << a << " and " << b;
    }
  }
}

TEST(Names, OfConstraints) {
  EXPECT_EQ(constraint_kind(PrimitiveKind::plane), "planar");
  EXPECT_EQ(constraint_kind(PrimitiveKind::cylinder), "cylindrical");
  EXPECT_EQ(constraint_kind(PrimitiveKind::sphere), "spherical");
  EXPECT_EQ(constraint_kind(PrimitiveKind::cone), "conical");
  EXPECT_EQ(constraint_kind(EdgeKind::line), "straight");
  EXPECT_EQ(constraint_kind(EdgeKind::circle), "circular");
  EXPECT_EQ(constraint_kind(EdgeKind::arc), "circular");
}

}  // namespace
}  // namespace deform::detect_test
