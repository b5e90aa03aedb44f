// SPDX-License-Identifier: GPL-3.0-or-later
// Meshes prepared for detection: what faces measure, what is beside them, how noisy the points are.
#include "core/constraints/detection/surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <set>

#include "core/constraints/detection/judgement.h"
#include "core/constraints/detection/seeds.h"
#include "tests/core/constraints/detection/parts.h"

namespace deform::surface_test {
namespace {

using detection::FitData;
using detection::Limits;
using detection::Neighbour;
using detection::Region;
using detection::Shape;
using detection::Surface;
using detection::Vector3d;
using test::Part;

Vector3d vector_of(const Vec3& p) { return {p[0], p[1], p[2]}; }

void add_face(Mesh& mesh, const std::vector<PointId>& ids) {
  mesh.face_sizes.push_back(static_cast<std::uint32_t>(ids.size()));
  mesh.face_points.insert(mesh.face_points.end(), ids.begin(), ids.end());
}

/// Columns x rows quadrilaterals over the unit square, at these heights.
template <typename Height>
Mesh sheet(int columns, int rows, const Height& height) {
  Mesh mesh;
  for (int j = 0; j <= rows; ++j) {
    for (int i = 0; i <= columns; ++i) {
      const double x = static_cast<double>(i) / columns, y = static_cast<double>(j) / rows;
      mesh.points.push_back({x, y, height(x, y)});
    }
  }
  const auto id = [&](int i, int j) { return static_cast<PointId>(j * (columns + 1) + i); };
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) add_face(mesh, {id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)});
  }
  return mesh;
}

TEST(Surface, MeasuresFaces) {
  Mesh mesh;  // an L of six corners in the plane x = 3, and a triangle beside it
  for (const auto& [y, z] : std::vector<std::pair<double, double>>{{0, 0}, {4, 0}, {4, 1}, {1, 1}, {1, 3}, {0, 3}}) {
    mesh.points.push_back({3, y, z});
  }
  mesh.points.push_back({5, 2, 0});
  add_face(mesh, {0, 1, 2, 3, 4, 5});
  add_face(mesh, {1, 0, 6});
  const Surface surface(mesh, {});
  ASSERT_EQ(surface.face_count(), 2u);
  const double unit = surface.size;
  EXPECT_NEAR(surface.area[0] * unit * unit, 6, 1e-12);
  EXPECT_NEAR(surface.area[1] * unit * unit, 4, 1e-12);
  EXPECT_NEAR(surface.model_area, 10, 1e-12);
  EXPECT_NEAR(surface.total_area * unit * unit, 10, 1e-12);
  EXPECT_NEAR(surface.height[0] * unit, 2 * 6 / 4.0, 1e-12) << "twice the area over the longest edge";
  EXPECT_NEAR(surface.height[1] * unit, 2, 1e-12);
  EXPECT_NEAR(std::abs(surface.normal[0][0]), 1, 1e-12);
  EXPECT_NEAR(std::abs(surface.normal[1][2]), 1, 1e-12);
  // In model units again.
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    EXPECT_LE((surface.middle + unit * surface.points[i] - vector_of(mesh.points[i])).norm(), 1e-12);
  }
  // The middle of the corners of faces by area, and a diameter around it.
  const Vector3d middle = (6 * Vector3d(3, 10.0 / 6, 8.0 / 6) + 4 * Vector3d(11.0 / 3, 2, 0)) / 10;
  EXPECT_LE((surface.middle - middle).norm(), 1e-12);
  double farthest = 0;
  for (const Vec3& p : mesh.points) farthest = std::max(farthest, (vector_of(p) - middle).norm());
  EXPECT_NEAR(unit, 2 * farthest, 1e-12);
  ASSERT_EQ(surface.neighbours(0).size(), 1u);
  EXPECT_NEAR(surface.neighbours(0)[0].angle, std::numbers::pi / 2, 1e-12);
}

TEST(Surface, FindsWhatSharesAnEdge) {
  Part part = test::filleted_shaft(1);
  // Every third face is turned around: the angles stay.
  Mesh turned = part.mesh;
  for (std::size_t f = 0; f < turned.face_count(); f += 3) std::swap(turned.face_points[3 * f], turned.face_points[3 * f + 1]);
  const Surface surface(turned, {}), plain(part.mesh, {});
  const std::size_t faces = plain.face_count();
  std::size_t edges = 0;
  for (FaceId a = 0; a < faces; ++a) {
    for (FaceId b = 0; b < faces; ++b) {
      std::set<PointId> common;
      for (const PointId p : plain.corners(a)) {
        const auto other = plain.corners(b);
        if (std::find(other.begin(), other.end(), p) != other.end()) common.insert(p);
      }
      const bool share = a != b && common.size() == 2;
      const auto list = surface.neighbours(a);
      const auto place = std::find_if(list.begin(), list.end(), [&](const Neighbour& n) { return n.face == b; });
      ASSERT_EQ(place != list.end(), share) << a << " and " << b;
      if (!share) continue;
      ++edges;
      EXPECT_EQ(place->from, *common.begin());
      EXPECT_EQ(place->to, *common.rbegin());
      const double cosine = plain.normal[a].dot(plain.normal[b]);  // its faces all run the same way around
      EXPECT_NEAR(std::cos(place->angle), cosine, 1e-12);
    }
  }
  EXPECT_EQ(edges, 3 * faces) << "closed";
  // All to one side.
  const double side = surface.normal[0].dot(plain.normal[0]);
  for (std::size_t f = 0; f < faces; ++f) EXPECT_NEAR(surface.normal[f].dot(plain.normal[f]), side, 1e-9);
}

TEST(Surface, JoinsPointsAndKeepsFacesWithoutArea) {
  Mesh mesh = sheet(2, 1, [](double, double) { return 0.0; });
  // The second face has points of its own.
  mesh.points.insert(mesh.points.end(), {mesh.points[1], mesh.points[4]});
  mesh.face_points[4] = 6;
  mesh.face_points[7] = 7;
  add_face(mesh, {0, 3, 3});  // no area, on the left edge
  add_face(mesh, {0, 2});
  const Surface surface(mesh, {});
  ASSERT_EQ(surface.face_count(), 4u);
  EXPECT_EQ(surface.corners(1)[0], 1u);
  EXPECT_EQ(surface.corners(1)[3], 4u);
  ASSERT_EQ(surface.neighbours(1).size(), 1u);
  EXPECT_EQ(surface.neighbours(1)[0].face, 0u);
  EXPECT_NEAR(surface.neighbours(1)[0].angle, 0, 1e-15);
  ASSERT_EQ(surface.neighbours(2).size(), 2u) << "to and fro on the same edge";
  EXPECT_EQ(surface.neighbours(2)[0].angle, 0);
  EXPECT_EQ(surface.neighbours(3).size(), 0u) << "two corners are no face";
  for (const std::size_t f : {2u, 3u}) {
    EXPECT_EQ(surface.area[f], 0);
    EXPECT_EQ(surface.normal[f], Vector3d(0, 0, 0));
    EXPECT_EQ(surface.allowance(f), 1.6);
  }
}

/// Blades around the z axis.
Mesh wheel(int blades) {
  Mesh mesh;
  mesh.points = {{0, 0, 0}, {0, 0, 1}};
  for (int i = 0; i < blades; ++i) {
    const double angle = 2 * std::numbers::pi * i / blades;
    mesh.points.push_back({std::cos(angle), std::sin(angle), 0.5});
    add_face(mesh, {0, 1, static_cast<PointId>(2 + i)});
  }
  return mesh;
}

// Beside a line of very many faces each has two neighbours there, not all.
TEST(Surface, KeepsCrowdedEdgesShort) {
  for (const int blades : {3, 6}) {
    const Surface all(wheel(blades), {});
    for (std::size_t f = 0; f < all.face_count(); ++f) EXPECT_EQ(all.neighbours(f).size(), static_cast<std::size_t>(blades - 1));
  }
  const Surface many(wheel(7), {});
  for (std::size_t f = 0; f < 7; ++f) {
    std::set<FaceId> found, expected;
    for (const Neighbour& n : many.neighbours(f)) found.insert(n.face);
    if (f > 0) expected.insert(static_cast<FaceId>(f - 1));
    if (f < 6) expected.insert(static_cast<FaceId>(f + 1));
    EXPECT_EQ(found, expected);
  }
}

TEST(Surface, PassesWhereTheAngleIsSmall) {
  // Strips that bend by 0.1, 0.2 ... 0.5 at their joints.
  Mesh mesh;
  double x = 0, z = 0, angle = 0;
  for (int i = 0; i <= 6; ++i) {
    mesh.points.insert(mesh.points.end(), {{x, 0, z}, {x, 1, z}});
    angle += 0.1 * i;
    x += std::cos(angle);
    z += std::sin(angle);
  }
  for (PointId i = 0; i < 6; ++i) add_face(mesh, {2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1});
  Surface surface(mesh, {});
  surface.find_passages(0.25);
  for (std::size_t f = 0; f < 6; ++f) {
    std::set<FaceId> found, expected;
    for (const FaceId n : surface.passages(f)) found.insert(n);
    if (f >= 1 && f <= 2) expected.insert(static_cast<FaceId>(f - 1));
    if (f <= 1) expected.insert(static_cast<FaceId>(f + 1));
    EXPECT_EQ(found, expected) << f;
    EXPECT_EQ(surface.level[f], 0);
    EXPECT_NEAR(surface.least_cosine[f], std::cos(0.125), 1e-6);
  }
  // Noise allows for more: 4 standard deviations over the height of each of the two.
  surface.noise = 0.04 * surface.height[2] / 8;
  EXPECT_NEAR(surface.allowance(2), 0.02, 1e-6);
  surface.find_passages(0.25);
  EXPECT_EQ(surface.passages(2).size(), 1u);
  EXPECT_NEAR(surface.least_cosine[2], std::cos(0.145), 1e-6);
  surface.noise = 0.06 * surface.height[2] / 8;
  surface.find_passages(0.25);
  EXPECT_EQ(surface.passages(2).size(), 2u);
  surface.noise = surface.height[2];
  surface.find_passages(0.25);
  EXPECT_EQ(surface.least_cosine[2], -1);
  const Surface flat = [] {
    Surface made(sheet(2, 1, [](double, double) { return 0.0; }), {});
    made.find_passages(0.25);
    return made;
  }();
  EXPECT_EQ(flat.level[0], 1);
}

// Sums over the data of a fit are integrals over the faces, whether all of them are taken or some.
TEST(Surface, GivesDataByArea) {
  for (const int n : {10, 14, 40}) {  // below 200 faces with all their corners, above with one each, and every fourth
    SCOPED_TRACE(n);
    const Surface surface(sheet(n, n, [](double, double) { return 0.0; }), {});
    std::vector<FaceId> faces(surface.face_count());
    std::iota(faces.begin(), faces.end(), 0);
    const std::size_t most = n == 40 ? 400 : 1000, stride = n == 40 ? 4 : 1;
    const FitData data = surface.data(faces, most);
    const std::size_t taken = faces.size() / stride;
    EXPECT_EQ(data.centres.size(), taken);
    EXPECT_EQ(data.corners.size(), n < 15 ? 4 * taken : taken);
    double corner_area = 0, area = 0;
    Vector3d corner_mean = Vector3d::Zero(), mean = Vector3d::Zero();
    for (std::size_t i = 0; i < data.corners.size(); ++i) {
      corner_area += data.corner_weights[i];
      corner_mean += data.corner_weights[i] * data.corners[i];
    }
    for (std::size_t i = 0; i < data.centres.size(); ++i) {
      area += data.weights[i];
      mean += data.weights[i] * data.centres[i];
      EXPECT_EQ(data.normals[i], surface.normal[faces[i * stride]]);
    }
    EXPECT_NEAR(corner_area * static_cast<double>(stride), surface.total_area, 1e-12);
    EXPECT_NEAR(area * static_cast<double>(stride), surface.total_area, 1e-12);
    EXPECT_LE((mean / area).norm(), n == 40 ? 0.05 : 1e-12) << "the middle is the origin";
    EXPECT_LE((corner_mean / corner_area).norm(), n < 15 ? 1e-12 : 0.05);
    // Not the same corner of each.
    if (n < 15) continue;
    std::set<std::pair<bool, bool>> corners;
    for (std::size_t i = 0; i < data.corners.size(); ++i) {
      const Vector3d d = data.corners[i] - data.centres[i];
      corners.insert({d[0] > 0, d[1] > 0});
    }
    EXPECT_EQ(corners.size(), 4u);
  }
}

/// The mesh with normal noise of that deviation in every coordinate.
Mesh noisy(Mesh mesh, double deviation) {
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal(0, deviation);
  for (Vec3& p : mesh.points) {
    for (double& x : p) x += normal(random);
  }
  return mesh;
}

TEST(Noise, IsEstimatedOnSmoothSurfaces) {
  const auto bent = [](double x, double y) { return 0.06 * x * x - 0.04 * x * y + 0.02 * y * y; };
  for (const double deviation : {1e-5, 1e-4, 1e-3}) {
    const Surface surface(noisy(sheet(25, 25, bent), deviation), {});
    const double found = detection::estimated_noise(surface, 0.6, {}) * surface.size;
    // The lower quartile of standard deviations that each come from about 12 degrees of freedom or more.
    EXPECT_GT(found, 0.7 * deviation);
    EXPECT_LT(found, 1.1 * deviation);
  }
  EXPECT_LT(detection::estimated_noise(Surface(sheet(25, 25, bent), {}), 0.6, {}), 2e-5) << "of a height over the tangent plane";
  EXPECT_LT(detection::estimated_noise(Surface(test::cube(6).mesh, {}), 0.6, {}), 1e-15) << "sharp edges do not count";
  EXPECT_EQ(detection::estimated_noise(Surface(sheet(2, 2, bent), {}), 0.6, {}), 0) << "too few points";
}

// ---- what is evidence for a shape ----

/// A patch of a cylinder of radius 1 that turns by so many radians, 2 long, and the region of all its faces.
struct Patch {
  Surface surface;
  Region region;

  Patch(double turn, double deviation, int n = 16) {
    Part part;
    part.sheet(0, n, n, [&](int i, int j) -> Vec3 {
      const double angle = turn * i / n;
      return {std::cos(angle), std::sin(angle), 2.0 * j / n};
    });
    surface = Surface(noisy(part.mesh, deviation), {});
    surface.noise = deviation / surface.size;
    region.shape.kind = PrimitiveKind::cylinder;
    region.shape.point = (Vector3d(0, 0, 0) - surface.middle) / surface.size;
    region.shape.radius = 1 / surface.size;
    region.faces.resize(surface.face_count());
    std::iota(region.faces.begin(), region.faces.end(), 0);
    region.area = surface.total_area;
    region.rms = detection::rms_distance(region.shape, surface.data(region.faces, 100000));
  }
  /// How far its middle is above its chord.
  static double sagitta(double turn) { return 1 - std::cos(turn / 2); }
};

TEST(Evidence, IsASagittaThatNoiseDoesNotExplain) {
  for (const double turn : {0.8, 2.0}) {  // more than 30 degrees: 20 times the noise
    const double sagitta = Patch::sagitta(turn);
    const Patch clear(turn, sagitta / 22), vague(turn, sagitta / 18);
    EXPECT_TRUE(detection::evident(clear.surface, clear.region)) << turn;
    EXPECT_FALSE(detection::evident(vague.surface, vague.region)) << turn;
  }
  // Below, 200 times, and pure noise.
  const double sagitta = Patch::sagitta(0.4);
  const Patch clear(0.4, sagitta / 220), vague(0.4, sagitta / 180), flat(0.15, Patch::sagitta(0.15) / 400);
  EXPECT_TRUE(detection::evident(clear.surface, clear.region));
  EXPECT_FALSE(detection::evident(vague.surface, vague.region));
  EXPECT_FALSE(detection::evident(flat.surface, flat.region)) << "less than 9 degrees";
  // Errors that are no noise: 100 times.
  Patch systematic(0.8, Patch::sagitta(0.8) / 500);
  systematic.region.rms = Patch::sagitta(0.8) / systematic.surface.size / 90;
  EXPECT_FALSE(detection::evident(systematic.surface, systematic.region));
  systematic.region.rms = Patch::sagitta(0.8) / systematic.surface.size / 110;
  EXPECT_TRUE(detection::evident(systematic.surface, systematic.region));
  Patch plane(0.8, 1e-3);
  plane.region.shape.kind = PrimitiveKind::plane;
  plane.region.rms = 1;
  EXPECT_TRUE(detection::evident(plane.surface, plane.region)) << "of planes nothing is asked";
}

Limits limits_of(double tolerance) {
  Limits limits;
  limits.tolerance = tolerance;
  limits.floor = tolerance / 40;
  limits.maximum_angle = 0.6;
  limits.kinds = {PrimitiveKind::plane, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::cone};
  return limits;
}

TEST(Evidence, TellsNoiseFromAnotherShape) {
  const double turn = 1.5;
  const Patch noise(turn, 1e-3);
  const Limits limits = limits_of(0.01);
  EXPECT_TRUE(detection::noisy(noise.surface, limits, noise.region.shape, noise.region.faces));
  EXPECT_TRUE(detection::convincing(noise.surface, limits, noise.region));
  // The same noise around a cylinder of another radius, 20 times as far off.
  Region off = noise.region;
  off.shape.radius *= 1.02;
  off.rms = detection::rms_distance(off.shape, noise.surface.data(off.faces, 100000));
  EXPECT_FALSE(detection::noisy(noise.surface, limits_of(0.03), off.shape, off.faces));
  EXPECT_FALSE(detection::convincing(noise.surface, limits_of(0.03), off));
  // Few points do not decide it; their distance must be small then.
  const Patch few(turn, 1e-3, 4);
  EXPECT_TRUE(detection::noisy(few.surface, limits, off.shape, few.region.faces));
  Region coarse = few.region;
  coarse.rms = 0.19 * limits.tolerance;
  EXPECT_TRUE(detection::convincing(few.surface, limits, coarse));
  coarse.rms = 0.21 * limits.tolerance;
  EXPECT_FALSE(detection::convincing(few.surface, limits, coarse));
}

TEST(Evidence, GivesTheSimplestKind) {
  const Patch patch(1.5, 1e-5);
  const Limits limits = limits_of(0.01);
  Region region = patch.region;
  // Given as a cone that nearly is this cylinder.
  region.shape.kind = PrimitiveKind::cone;
  region.shape.angle = 0.01;
  region.shape.sine = std::sin(0.01);
  region.shape.cosine = std::cos(0.01);
  const Region simple = detection::simplest(patch.surface, limits, region);
  EXPECT_EQ(simple.shape.kind, PrimitiveKind::cylinder);
  EXPECT_NEAR(simple.shape.radius * patch.surface.size, 1, 1e-4);
  EXPECT_EQ(simple.faces, region.faces);
  Limits no_cylinders = limits;
  no_cylinders.kinds = {PrimitiveKind::plane, PrimitiveKind::cone};
  EXPECT_EQ(detection::simplest(patch.surface, no_cylinders, region).shape.kind, PrimitiveKind::cone);
}

// ---- seeds ----

TEST(Seeds, PatchesEndAtTheAngle) {
  const Surface surface(test::cube(3).mesh, {});
  const auto patches = detection::smooth_patches(surface, 0.5);
  ASSERT_EQ(patches.begin.size(), 7u);
  EXPECT_EQ(patches.order.size(), surface.face_count());
  for (std::size_t p = 0; p < 6; ++p) {
    EXPECT_EQ(patches.begin[p + 1] - patches.begin[p], 18u);
    for (std::size_t i = patches.begin[p]; i < patches.begin[p + 1]; ++i) {
      EXPECT_GT(surface.normal[patches.order[i]].dot(surface.normal[patches.order[patches.begin[p]]]), 0.999);
    }
  }
  EXPECT_EQ(detection::smooth_patches(surface, 1.6).begin.size(), 2u) << "around the edges";
}

// Over a paraboloid the curvature changes slowly, across a crease at once.
TEST(Seeds, UnevennessIsWhereTheCurvatureChanges) {
  const auto crease = [](double x, double) { return x < 0.5 ? 0.0 : 0.3 * (x - 0.5); };
  const Surface surface(sheet(20, 20, crease), {});
  const std::vector<double> uneven = detection::curvature_unevenness(surface);
  double across = 0;
  for (std::size_t f = 0; f < uneven.size(); ++f) {
    const double x = surface.middle[0] + surface.size * surface.centre[f][0];
    if (std::abs(x - 0.5) > 0.11) {
      EXPECT_NEAR(uneven[f], 0, 1e-9) << x;
    } else {
      across = std::max(across, uneven[f]);
    }
  }
  // Beside the end of the crease: its angle times the length of an edge, over the area of the face and thirds of its neighbours.
  const double side = 0.05 / surface.size, angle = std::atan(0.3);
  EXPECT_NEAR(across, angle * side / (side * side * (1 + 2 / 3.0 + std::sqrt(1.09) / 3)), 1e-9 * across);
}

TEST(Seeds, AreSpreadByArea) {
  const Surface surface(sheet(30, 30, [](double, double) { return 0.0; }), {});
  Limits limits = limits_of(0.01);
  limits.minimum_area = surface.total_area / 50;
  const auto patches = detection::smooth_patches(surface, 0.5);
  const std::vector<double> even(surface.face_count(), 0);
  std::vector<std::uint32_t> labels(surface.face_count(), detection::unlabelled);
  const auto seeds = detection::spread_seeds(surface, limits, patches, even, labels, 0);
  EXPECT_NEAR(static_cast<double>(seeds.size()), 100, 2) << "two for each area of the smallest primitive";
  EXPECT_EQ(std::set<FaceId>(seeds.begin(), seeds.end()).size(), seeds.size());
  EXPECT_EQ(detection::spread_seeds(surface, limits, patches, even, labels, 0), seeds);
  EXPECT_NE(detection::spread_seeds(surface, limits, patches, even, labels, 1), seeds) << "others in another sweep";
  // Labelled faces are taken already; the most even ones are preferred.
  std::vector<double> uneven(surface.face_count(), 0);
  for (std::size_t f = 0; f < uneven.size(); ++f) {
    if (f % 30 < 10) labels[f] = 0;
    uneven[f] = f % 2 == 0 ? 1 : 0;
  }
  const auto rest = detection::spread_seeds(surface, limits, patches, uneven, labels, 0);
  EXPECT_NEAR(static_cast<double>(rest.size()), 67, 2);
  std::size_t good = 0;
  for (const FaceId f : rest) {
    EXPECT_EQ(labels[f], detection::unlabelled);
    good += f % 2;
  }
  EXPECT_GT(good, 0.95 * static_cast<double>(rest.size()));
  // Nothing to look for where less is left than a primitive needs.
  for (std::size_t f = 17; f < labels.size(); ++f) labels[f] = 0;
  EXPECT_TRUE(detection::spread_seeds(surface, limits, patches, even, labels, 0).empty());
}

TEST(Seeds, RandomNumbersAreUniform) {
  detection::Random random(3, 4), same(3, 4), other(3, 5), another(4, 4);
  std::vector<int> counts(10, 0);
  double sum = 0, product = 0, last = 0.5;
  bool differs = false, another_differs = false;
  for (int i = 0; i < 20000; ++i) {
    const double u = random.unit();
    ASSERT_GE(u, 0);
    ASSERT_LT(u, 1);
    EXPECT_EQ(same.unit(), u);
    differs = differs || other.unit() != u;
    another_differs = another_differs || another.unit() != u;
    ++counts[static_cast<std::size_t>(10 * u)];
    sum += u - 0.5;
    product += (u - 0.5) * (last - 0.5);
    last = u;
  }
  EXPECT_TRUE(differs) << "another stream";
  EXPECT_TRUE(another_differs) << "another seed";
  EXPECT_LT(std::abs(sum), 4 * std::sqrt(20000 / 12.0));
  EXPECT_LT(std::abs(product), 4 * std::sqrt(20000.0) / 12);
  for (const int count : counts) EXPECT_NEAR(count, 2000, 4 * std::sqrt(1800.0));
  for (int i = 0; i < 100; ++i) EXPECT_LT(random.below(7), 7u);
  // The first values of SplitMix64 from 1234567, which stream 10254634113186738926 begins with.
  detection::Random known(0, 10254634113186738926u);
  for (const std::uint64_t value : {6457827717110365317u, 3203168211198807973u, 9817491932198370423u}) {
    EXPECT_EQ(known.unit(), static_cast<double>(value >> 11) * 0x1p-53);
  }
}

}  // namespace
}  // namespace deform::surface_test
