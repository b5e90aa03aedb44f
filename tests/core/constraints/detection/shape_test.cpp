// SPDX-License-Identifier: GPL-3.0-or-later
// Fits of single shapes to corners and normals.
#include "core/constraints/detection/shape.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

namespace deform::shape_test {
namespace {

using detection::Effort;
using detection::FitData;
using detection::Shape;
using detection::Vector3d;

constexpr double degree = std::numbers::pi / 180;

/// A shape that nothing is aligned with.
Shape shape_of(PrimitiveKind kind, double radius = 0.3, double angle = 25 * degree) {
  Shape shape;
  shape.kind = kind;
  shape.point = {0.1, -0.2, 0.15};
  shape.axis = Vector3d(1, 2, -0.5).normalized();
  if (kind != PrimitiveKind::plane) shape.radius = radius;
  if (kind == PrimitiveKind::cone) {
    shape.angle = angle;
    shape.sine = std::sin(angle);
    shape.cosine = std::cos(angle);
  }
  return shape;
}

constexpr PrimitiveKind all_kinds[] = {PrimitiveKind::plane, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::cone};

/// The place of the shape with these coordinates, and the outer normal there, both from the parametric form: u around the axis
/// (radians) and v along a straight line of the surface; a sphere: azimuth, and the polar angle 2 + v.
struct Place {
  Vector3d x, normal;
};
Place place_of(const Shape& shape, double u, double v) {
  const Vector3d e1 = shape.axis.unitOrthogonal(), e2 = shape.axis.cross(e1);
  const Vector3d around = std::cos(u) * e1 + std::sin(u) * e2;
  switch (shape.kind) {
    case PrimitiveKind::plane:
      return {shape.point + u * e1 + v * e2, shape.axis};
    case PrimitiveKind::sphere: {
      const Vector3d n = std::sin(2 + v) * around + std::cos(2 + v) * shape.axis;
      return {shape.point + shape.radius * n, n};
    }
    case PrimitiveKind::cylinder:
      return {shape.point + v * shape.axis + shape.radius * around, around};
    case PrimitiveKind::cone:
      break;
  }
  const double sine = std::sin(shape.angle), cosine = std::cos(shape.angle);
  return {shape.point + v * cosine * shape.axis + (shape.radius + v * sine) * around, cosine * around - sine * shape.axis};
}

/// A patch of 9 x 6 corners and as many normals, the weights all different; `inward` as in a bore.
FitData patch_of(const Shape& shape, double inward = 1) {
  FitData data;
  for (int i = 0; i < 9; ++i) {
    for (int j = 0; j < 6; ++j) {
      const Place corner = place_of(shape, 0.3 * i, 0.07 * j - 0.1), middle = place_of(shape, 0.3 * i + 0.1, 0.07 * j - 0.08);
      data.corners.push_back(corner.x);
      data.corner_weights.push_back(1 + 0.1 * i + 0.03 * j);
      data.centres.push_back(middle.x);
      data.normals.push_back(inward * middle.normal);
      data.weights.push_back(1 + 0.05 * i + 0.1 * j);
    }
  }
  return data;
}

FitData shaken(FitData data, double size) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> any(-size, size);
  for (Vector3d& x : data.corners) x += Vector3d(any(random), any(random), any(random));
  return data;
}

void expect_same_shape(const Shape& found, const Shape& truth, double tolerance) {
  ASSERT_EQ(found.kind, truth.kind);
  if (truth.kind != PrimitiveKind::sphere) {
    EXPECT_NEAR(found.axis.norm(), 1, 1e-12);
    EXPECT_LE(found.axis.cross(truth.axis).norm(), tolerance);
  }
  const Vector3d off = found.point - truth.point;
  switch (truth.kind) {
    case PrimitiveKind::plane:
      EXPECT_LE(std::abs(off.dot(truth.axis)), tolerance);
      return;
    case PrimitiveKind::sphere:
      EXPECT_LE(off.norm(), tolerance);
      EXPECT_NEAR(found.radius, truth.radius, tolerance);
      return;
    case PrimitiveKind::cylinder:
      EXPECT_LE((off - off.dot(truth.axis) * truth.axis).norm(), tolerance);
      EXPECT_NEAR(found.radius, truth.radius, tolerance);
      return;
    case PrimitiveKind::cone:
      EXPECT_LE((found.apex() - truth.apex()).norm(), tolerance);
      EXPECT_GT(found.axis.dot(truth.axis), 0) << "towards the wider side";
      EXPECT_NEAR(found.angle, truth.angle, tolerance);
      EXPECT_NEAR(found.sine, std::sin(found.angle), 1e-15);
      EXPECT_NEAR(found.cosine, std::cos(found.angle), 1e-15);
  }
}

TEST(Shape, FeetAreOnTheShape) {
  for (const PrimitiveKind kind : all_kinds) {
    SCOPED_TRACE(static_cast<int>(kind));
    const Shape shape = shape_of(kind);
    for (const double away : {-0.12, 0.0, 0.05, 0.4}) {
      const Place place = place_of(shape, 0.8, 0.13);
      const Shape::Foot foot = shape.foot(place.x + away * place.normal);
      EXPECT_NEAR(foot.distance, away, 1e-14);
      EXPECT_LE((foot.normal - place.normal).norm(), 1e-13);
      EXPECT_EQ(shape.distance(place.x + away * place.normal), foot.distance);
    }
  }
  // On the axis and in the centre any direction is nearest.
  for (const PrimitiveKind kind : {PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::cone}) {
    const Shape shape = shape_of(kind);
    EXPECT_NEAR(shape.foot(shape.point).normal.norm(), 1, 1e-14);
    EXPECT_NEAR(shape.foot(shape.point).distance, -0.3 * shape.cosine, 1e-15);
  }
}

TEST(Fits, FindTheShapeOfExactData) {
  for (const PrimitiveKind kind : all_kinds) {
    for (const double inward : {1.0, -1.0}) {
      SCOPED_TRACE(testing::Message() << static_cast<int>(kind) << ", normals times " << inward);
      const Shape truth = shape_of(kind);
      const FitData data = patch_of(truth, inward);
      const auto guess = detection::guess(kind, data);
      ASSERT_TRUE(guess);
      expect_same_shape(*guess, truth, 1e-9);
      const auto found = detection::fitted(kind, data, Effort::full);
      ASSERT_TRUE(found);
      expect_same_shape(*found, truth, 1e-9);
      EXPECT_LE(detection::rms_distance(*found, data), 1e-12);
      EXPECT_LE(detection::rms_angle(*found, data), 1e-6);
    }
  }
}

// The point is beside the middle of the corners, by their weights.
TEST(Fits, PutThePointOfAnAxisBesideTheCorners) {
  for (const PrimitiveKind kind : {PrimitiveKind::cylinder, PrimitiveKind::cone}) {
    const Shape truth = shape_of(kind);
    const FitData data = patch_of(truth);
    Vector3d sum = Vector3d::Zero();
    double weight = 0;
    for (std::size_t i = 0; i < data.corners.size(); ++i) {
      sum += data.corner_weights[i] * data.corners[i];
      weight += data.corner_weights[i];
    }
    Shape start = truth;
    start.point += 0.11 * truth.axis;
    start.radius += 0.11 * std::tan(truth.angle);
    const auto found = detection::refine(start, data, Effort::full);
    ASSERT_TRUE(found);
    expect_same_shape(*found, truth, 1e-9);
    EXPECT_NEAR((sum / weight - found->point).dot(found->axis), 0, 1e-12);
    if (kind == PrimitiveKind::cylinder) continue;
    const double height = (found->point - truth.point).dot(truth.axis);
    EXPECT_NEAR(found->radius, truth.radius + height * std::tan(truth.angle), 1e-9);
  }
}

/// Sum of weighted squared distances, from the feet.
double error_of(const Shape& shape, const FitData& data) {
  double sum = 0;
  for (std::size_t i = 0; i < data.corners.size(); ++i) {
    sum += data.corner_weights[i] * shape.distance(data.corners[i]) * shape.distance(data.corners[i]);
  }
  return sum;
}

/// All neighbours of a shape that differ by `step` in one of its parameters.
std::vector<Shape> neighbours_of(const Shape& shape, double step) {
  const Vector3d e1 = shape.axis.unitOrthogonal(), e2 = shape.axis.cross(e1);
  std::vector<Shape> all;
  for (const double s : {-step, step}) {
    for (const Vector3d& e : {e1, e2, shape.axis}) {
      all.push_back(shape);
      all.back().point += s * e;
      all.push_back(shape);
      all.back().axis = (shape.axis + s * e).normalized();
    }
    all.push_back(shape);
    all.back().radius += s;
    if (shape.kind != PrimitiveKind::cone) continue;
    all.push_back(shape);
    all.back().angle += s;
    all.back().sine = std::sin(all.back().angle);
    all.back().cosine = std::cos(all.back().angle);
  }
  return all;
}

TEST(Fits, AreTheLeastSquaresFit) {
  for (const PrimitiveKind kind : all_kinds) {
    SCOPED_TRACE(static_cast<int>(kind));
    const FitData data = shaken(patch_of(shape_of(kind)), 0.01);
    const auto found = detection::fitted(kind, data, Effort::full);
    ASSERT_TRUE(found);
    const double least = error_of(*found, data);
    for (const Shape& other : neighbours_of(*found, 3e-5)) EXPECT_GE(error_of(other, data), least * (1 - 1e-12));
    double weight = 0;
    for (const double w : data.corner_weights) weight += w;
    EXPECT_NEAR(detection::rms_distance(*found, data), std::sqrt(least / weight), 1e-14);
    // In a hurry: near, from the same start.
    const auto quick = detection::fitted(kind, data, Effort::quick);
    ASSERT_TRUE(quick);
    EXPECT_LE(error_of(*quick, data), 1.1 * least);
    EXPECT_GE(error_of(*quick, data), least * (1 - 1e-8));
  }
}

// From farther away: refining does not depend on a good first guess.
TEST(Fits, ComeBackFromAfar) {
  for (const PrimitiveKind kind : {PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::cone}) {
    SCOPED_TRACE(static_cast<int>(kind));
    const Shape truth = shape_of(kind);
    const FitData data = patch_of(truth);
    Shape start = truth;
    start.point += Vector3d(0.05, -0.08, 0.04);
    start.radius *= 1.4;
    start.axis = (truth.axis + Vector3d(0.2, 0, -0.1)).normalized();
    const auto found = detection::refine(start, data, Effort::full);
    ASSERT_TRUE(found);
    expect_same_shape(*found, truth, 1e-7);
  }
}

TEST(Fits, CountARepeatedCornerAsItsWeight) {
  for (const PrimitiveKind kind : all_kinds) {
    SCOPED_TRACE(static_cast<int>(kind));
    FitData once = shaken(patch_of(shape_of(kind)), 0.01);
    for (double& w : once.corner_weights) w = 1;
    for (double& w : once.weights) w = 1;
    FitData often = once;
    for (std::size_t i = 0; i < 12; ++i) {
      once.corner_weights[i] = once.weights[i] = 3;
      for (int more = 0; more < 2; ++more) {
        often.corners.push_back(once.corners[i]);
        often.corner_weights.push_back(1);
        often.centres.push_back(once.centres[i]);
        often.normals.push_back(once.normals[i]);
        often.weights.push_back(1);
      }
    }
    const auto a = detection::guess(kind, once), b = detection::guess(kind, often);
    ASSERT_TRUE(a && b);
    expect_same_shape(*a, *b, 1e-10);
    EXPECT_NEAR(detection::rms_distance(*a, once), detection::rms_distance(*a, often), 1e-14);
    EXPECT_NEAR(detection::rms_angle(*a, once), detection::rms_angle(*a, often), 1e-12);
    const auto c = detection::fitted(kind, once, Effort::full), d = detection::fitted(kind, often, Effort::full);
    ASSERT_TRUE(c && d);
    expect_same_shape(*c, *d, 1e-6);
  }
}

TEST(Fits, MeasureDistancesAndAngles) {
  const Shape plane = shape_of(PrimitiveKind::plane);
  const Vector3d across = plane.axis.unitOrthogonal();
  FitData data;
  data.corners = {plane.point + 0.1 * plane.axis, plane.point - 0.3 * plane.axis + across};
  data.corner_weights = {3, 1};
  data.centres = {plane.point, plane.point + across};
  data.normals = {std::cos(0.2) * plane.axis + std::sin(0.2) * across, -std::cos(0.5) * plane.axis + std::sin(0.5) * across};
  data.weights = {1, 4};
  EXPECT_NEAR(detection::rms_distance(plane, data), std::sqrt((3 * 0.01 + 0.09) / 4), 1e-15);
  EXPECT_NEAR(detection::rms_angle(plane, data), std::sqrt((0.04 + 4 * 0.25) / 5), 1e-14);
  EXPECT_EQ(detection::rms_distance(plane, {}), 0);
  EXPECT_EQ(detection::rms_angle(plane, {}), 0);
}

TEST(Fits, StayWithinLimits) {
  const auto with_radius = [](PrimitiveKind kind, double radius) {
    return detection::fitted(kind, patch_of(shape_of(kind, radius)), Effort::full).has_value();
  };
  for (const PrimitiveKind kind : {PrimitiveKind::cylinder, PrimitiveKind::sphere}) {
    EXPECT_TRUE(with_radius(kind, 19.9));
    EXPECT_FALSE(with_radius(kind, 20.1));
  }
  const auto with_angle = [](double angle) {
    const Shape cone = shape_of(PrimitiveKind::cone, 2, angle * degree);
    Shape start = cone;
    start.radius *= 1.0001;
    return detection::refine(start, patch_of(cone), Effort::full).has_value();
  };
  EXPECT_FALSE(with_angle(0.45));
  EXPECT_TRUE(with_angle(0.55));
  EXPECT_TRUE(with_angle(89.45));
  EXPECT_FALSE(with_angle(89.55));
}

TEST(Fits, NeedEnoughData) {
  const struct {
    PrimitiveKind kind;
    std::size_t parameters;
  } cases[] = {{PrimitiveKind::cylinder, 5}, {PrimitiveKind::sphere, 4}, {PrimitiveKind::cone, 6}};
  for (const auto& [kind, parameters] : cases) {
    const Shape truth = shape_of(kind);
    FitData data = patch_of(truth);
    data.corners.resize(parameters);
    data.corner_weights.resize(parameters);
    EXPECT_TRUE(detection::refine(truth, data, Effort::full)) << static_cast<int>(kind);
    data.corners.pop_back();
    data.corner_weights.pop_back();
    EXPECT_FALSE(detection::refine(truth, data, Effort::full)) << static_cast<int>(kind);
  }
  for (const PrimitiveKind kind : all_kinds) EXPECT_FALSE(detection::guess(kind, {})) << static_cast<int>(kind);
  // A plane has no axis of its own, a cylinder no apex.
  for (const PrimitiveKind kind : {PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::cone}) {
    EXPECT_FALSE(detection::guess(kind, patch_of(shape_of(PrimitiveKind::plane)))) << static_cast<int>(kind);
  }
  EXPECT_FALSE(detection::guess(PrimitiveKind::cone, patch_of(shape_of(PrimitiveKind::cylinder))));
}

}  // namespace
}  // namespace deform::shape_test
