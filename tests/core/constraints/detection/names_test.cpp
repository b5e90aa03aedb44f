// SPDX-License-Identifier: GPL-3.0-or-later
// Names of what is found, and which of it the rest implies.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <map>
#include <random>

#include "core/constraints/constraint.h"
#include "core/constraints/detection/implied.h"
#include "core/constraints/detection/names.h"
#include "tests/core/constraints/detection/parts.h"

namespace deform::names_test {
namespace {

using detection::short_number;
using Eigen::Vector3d;
using test::Part;
using testing::ElementsAre;

TEST(ShortNumber, HasAsManyDigitsAsItNeeds) {
  EXPECT_EQ(short_number(12.4998, 0.001), "12.5");
  EXPECT_EQ(short_number(12.4998, 0.00001), "12.4998");
  EXPECT_EQ(short_number(101.6, 0.05), "101.6");
  EXPECT_EQ(short_number(999.96, 0.5), "1000");
  EXPECT_EQ(short_number(0.3, 1e-9), "0.3");
  EXPECT_EQ(short_number(-0.25, 1e-3), "-0.25");
  EXPECT_EQ(short_number(-1e-5, 1e-3), "0");
  EXPECT_EQ(short_number(0, 0), "0");
  EXPECT_EQ(short_number(1234567, 500), "1235000");
  EXPECT_EQ(short_number(1.25e-5, 1e-9), "1.25e-5");
  EXPECT_EQ(short_number(3e12, 1e9), "3e12");
  EXPECT_EQ(short_number(1.0 / 3, 0), "0.3333333333333333");
  std::mt19937_64 random(1);
  for (int i = 0; i < 2000; ++i) {
    const double value = std::pow(10.0, std::uniform_real_distribution<double>(-9, 9)(random));
    const std::string text = short_number(value, 5e-4 * value);
    EXPECT_LE(std::abs(std::stod(text) - value), 5e-4 * value * (1 + 1e-9)) << value;
    EXPECT_LE(text.size(), 10u) << value;
  }
}

std::vector<std::string> names(const Detection& found) {
  std::vector<std::string> result;
  for (const Primitive& p : found.primitives) result.push_back(p.name);
  for (const EdgeFeature& e : found.edges) result.push_back(e.name);
  return result;
}

TEST(DetectedNames, SayKindAndMeasure) {
  const Detection plate = detect(test::plate_with_hole(2).mesh, {});
  const std::vector<std::string> found = names(plate);
  EXPECT_THAT(found, testing::IsSupersetOf({"plane_z0.3_1", "plane_z-0.3_1", "cylinder_d1_1", "circle_d1_1", "circle_d1_2"}));
  EXPECT_EQ(std::count_if(found.begin(), found.end(), [](const auto& n) { return n.starts_with("line_l0.6_"); }), 4);
  Mesh turned = test::cube(2).mesh;
  for (Vec3& p : turned.points) p = {0.8 * p[0] - 0.6 * p[1], 0.6 * p[0] + 0.8 * p[1], 5.08 * p[2]};
  EXPECT_THAT(names(detect(turned, {})),
              testing::IsSupersetOf({"plane_z0_1", "plane_z5.08_1", "plane_oblique_1", "plane_oblique_4", "line_l5.08_1"}));
}

TEST(DetectedNames, AreDifferentAndLegalOnEveryPart) {
  for (const Part& part : test::all_parts(2)) {
    SCOPED_TRACE(part.name);
    std::vector<std::string> found = names(detect(part.mesh, {}));
    for (const std::string& name : found) {
      EXPECT_TRUE(std::all_of(name.begin(), name.end(), [](unsigned char c) {
        return std::isalnum(c) != 0 || c == '_' || c == '.' || c == '-';
      })) << name;
    }
    std::sort(found.begin(), found.end());
    EXPECT_EQ(std::adjacent_find(found.begin(), found.end()), found.end());
  }
}

const EdgeFeature& edge_named(const Detection& found, const std::string& name) {
  return *std::find_if(found.edges.begin(), found.edges.end(), [&](const EdgeFeature& e) { return e.name == name; });
}

TEST(Implied, LinesOnTwoPlanesFollow) {
  const Detection cube = detect(test::cube(4).mesh, {});
  ASSERT_EQ(cube.edges.size(), 12u);
  for (const EdgeFeature& e : cube.edges) {
    ASSERT_EQ(e.implied_by.size(), 2u);
    EXPECT_NE(e.implied_by[0], e.implied_by[1]);
    EXPECT_EQ(e.implied_by, e.lies_on);
  }
  for (const Primitive& p : cube.primitives) EXPECT_THAT(p.implied_by, ElementsAre());
}

TEST(Implied, TheCircleThatKeepsABoreSquareStays) {
  const Detection plate = detect(test::plate_with_hole(2).mesh, {});
  for (const char* name : {"circle_d1_1", "circle_d1_2"}) {
    const EdgeFeature& rim = edge_named(plate, name);
    EXPECT_THAT(rim.implied_by, ElementsAre()) << "each is on a plane of its own";
    EXPECT_EQ(rim.lies_on.size(), 2u);
    EXPECT_THAT(rim.lies_on, testing::Contains("cylinder_d1_1"));
  }
}

TEST(Implied, APlaneWithoutPointsInsideItsRimFollowsFromTheRim) {
  Part part;  // a tube of 24 strips, closed by fans over three corners of the rim each
  part.revolve_line(part.truth(test::Truth::Kind::cylinder), 24, 3, 0.5, 0, 0.5, 1);
  const int cap = part.truth(test::Truth::Kind::plane);
  std::vector<PointId> rim;
  for (PointId p = 0; p < part.mesh.points.size(); ++p) {
    if (part.mesh.points[p][2] == 1) rim.push_back(p);
  }
  const auto angle = [&](PointId p) { return std::atan2(part.mesh.points[p][1], part.mesh.points[p][0]); };
  std::sort(rim.begin(), rim.end(), [&](PointId a, PointId b) { return angle(a) < angle(b); });
  for (std::size_t i = 1; i + 1 < rim.size(); ++i) part.triangle(cap, rim[0], rim[i], rim[i + 1]);
  const Detection found = detect(part.mesh, {});
  ASSERT_EQ(found.primitives.size(), 2u);
  EXPECT_EQ(found.primitives[0].name, "plane_z1_1");
  ASSERT_EQ(found.primitives[0].implied_by.size(), 1u);
  std::vector<PointId> circle = edge_named(found, found.primitives[0].implied_by[0]).points;
  std::sort(circle.begin(), circle.end());
  EXPECT_EQ(circle, found.primitives[0].points);
  EXPECT_EQ(edge_named(found, found.primitives[0].implied_by[0]).implied_by, std::vector<std::string>())
      << "one of the two stays";
}

/// A plane and something round that share the points 0 to 19, and two arcs of ten points each on both.
Detection slit(PrimitiveKind round) {
  Detection made;
  made.primitives.resize(2);
  made.primitives[0].name = "flat";
  made.primitives[0].axis = {0, 0, 1};
  made.primitives[1].name = "round";
  made.primitives[1].kind = round;
  for (std::size_t p = 0; p < 2; ++p) {
    made.primitives[p].constraint = constraint_kind(made.primitives[p].kind);
    for (PointId id = 0; id < 20; ++id) made.primitives[p].points.push_back(id);
    made.primitives[p].points.push_back(static_cast<PointId>(20 + p));
  }
  made.edges.resize(2);
  for (std::size_t e = 0; e < 2; ++e) {
    made.edges[e].kind = EdgeKind::arc;
    made.edges[e].name = e == 0 ? "long" : "short";
    made.edges[e].constraint = "circular";
    for (PointId id = 0; id < 10; ++id) made.edges[e].points.push_back(static_cast<PointId>(10 * e + id));
  }
  return made;
}

TEST(Implied, OneArcKeepsAPlaneSquareToWhatIsRound) {
  for (const PrimitiveKind kind : {PrimitiveKind::cylinder, PrimitiveKind::cone}) {
    Detection found = slit(kind);
    detection::find_implied(found);
    EXPECT_THAT(found.edges[0].implied_by, ElementsAre()) << static_cast<int>(kind);
    EXPECT_THAT(found.edges[1].implied_by, ElementsAre("flat", "round", "long")) << static_cast<int>(kind);
    // What has no constraint implies nothing.
    for (std::size_t p = 0; p < 2; ++p) {
      Detection less = slit(kind);
      less.primitives[p].constraint.clear();
      detection::find_implied(less);
      EXPECT_THAT(less.edges[1].implied_by, ElementsAre());
      EXPECT_THAT(less.edges[1].lies_on, ElementsAre("flat", "round"));
    }
    Detection first = slit(kind);
    first.edges[0].constraint.clear();
    detection::find_implied(first);
    EXPECT_THAT(first.edges[0].implied_by, ElementsAre());
    EXPECT_THAT(first.edges[1].implied_by, ElementsAre());
  }
  // A plane or another sphere meets a sphere in a circle: both arcs follow.
  Detection ball = slit(PrimitiveKind::sphere);
  detection::find_implied(ball);
  for (const EdgeFeature& edge : ball.edges) EXPECT_THAT(edge.implied_by, ElementsAre("flat", "round"));
  ball = slit(PrimitiveKind::sphere);
  ball.primitives[0].kind = PrimitiveKind::sphere;
  detection::find_implied(ball);
  for (const EdgeFeature& edge : ball.edges) EXPECT_THAT(edge.implied_by, ElementsAre("flat", "round"));
}

// ---- what is said to follow does ----

/// A surface near another one: moved, turned and resized by up to a tenth.
struct Bent {
  PrimitiveKind kind;
  Vector3d point, axis;
  double radius, half_angle;

  Bent(const Primitive& p, std::mt19937_64& random)
      : kind(p.kind), point(p.point.data()), axis(p.axis.data()), radius(p.radius), half_angle(p.half_angle) {
    std::uniform_real_distribution<double> any(-0.1, 0.1);
    point += 0.5 * Vector3d(any(random), any(random), any(random));
    if (kind != PrimitiveKind::sphere) axis = (axis + Vector3d(any(random), any(random), any(random))).normalized();
    radius *= 1 + any(random);
    half_angle *= 1 + any(random);
  }
  double distance(const Vector3d& x) const {
    const Vector3d q = x - point;
    const double h = q.dot(axis), across = (q - h * axis).norm();
    switch (kind) {
      case PrimitiveKind::plane:
        return h;
      case PrimitiveKind::sphere:
        return q.norm() - radius;
      case PrimitiveKind::cylinder:
        return across - radius;
      case PrimitiveKind::cone:
        break;
    }
    return across * std::cos(half_angle) - h * std::sin(half_angle);
  }
};

/// The point of both surfaces near x (Newton's method with the shortest steps).
Vector3d on_both(Vector3d x, const Bent& a, const Bent& b) {
  for (int round = 0; round < 30; ++round) {
    Eigen::Matrix<double, 2, 3> jacobian;
    const Eigen::Vector2d value(a.distance(x), b.distance(x));
    for (int k = 0; k < 3; ++k) {
      const Vector3d step = 1e-6 * Vector3d::Unit(k);
      jacobian.col(k) << (a.distance(x + step) - a.distance(x - step)) / 2e-6,
          (b.distance(x + step) - b.distance(x - step)) / 2e-6;
    }
    x -= jacobian.transpose() * (jacobian * jacobian.transpose()).ldlt().solve(value);
  }
  return x;
}

/// Largest distance of the points from what the constraint makes of them.
double misfit(const std::string& constraint, const std::vector<Vec3>& points) {
  ConstraintKind kind = Straight{};
  if (constraint == "circular") kind = Circular{};
  const std::vector<std::vector<Vec3>> regions{points};
  const auto projection = make_projection(kind, regions);
  std::vector<Vec3> targets(points.size());
  ShapeParameters shape;
  projection->project(points, targets, shape);
  double largest = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    largest = std::max(largest, (Vector3d(points[i].data()) - Vector3d(targets[i].data())).norm());
  }
  return largest;
}

/// The misfit of an edge whose points have gone to where two surfaces on which it lies meet after these were bent.
double misfit_when_bent(const Detection& found, const Mesh& mesh, const EdgeFeature& edge, std::mt19937_64& random) {
  std::vector<Bent> bent;
  for (const std::string& name : edge.lies_on) {
    for (const Primitive& p : found.primitives) {
      if (p.name == name) bent.emplace_back(p, random);
    }
  }
  std::vector<Vec3> points;
  for (const PointId id : edge.points) {
    const Vector3d x = on_both(Vector3d(mesh.points[id].data()), bent[0], bent[1]);
    points.push_back({x[0], x[1], x[2]});
  }
  return misfit(edge.constraint, points);
}

TEST(Implied, WhatFollowsHoldsHoweverTheRestIsBentAndTheRestDoesNot) {
  std::mt19937_64 random(3);
  std::map<bool, std::size_t> seen;
  for (const Part& part : test::all_parts(2)) {
    const Detection found = detect(part.mesh, {});
    for (const EdgeFeature& edge : found.edges) {
      if (edge.lies_on.size() != 2 || edge.constraint.empty()) continue;
      SCOPED_TRACE(part.name + " " + edge.name);
      const bool implied = !edge.implied_by.empty();
      if (edge.implied_by.size() > 2) continue;  // by another circle, too
      ++seen[implied];
      double largest = 0;
      for (int round = 0; round < 5; ++round) largest = std::max(largest, misfit_when_bent(found, part.mesh, edge, random));
      if (implied) {
        EXPECT_LT(largest, 1e-7);
      } else {
        EXPECT_GT(largest, 1e-5) << "this constraint adds nothing";
      }
    }
  }
  EXPECT_GT(seen[true], 20u);
  EXPECT_GT(seen[false], 5u);
}

}  // namespace
}  // namespace deform::names_test
