// SPDX-License-Identifier: GPL-3.0-or-later
// Elements whose measures are known.
#include "core/quality/element_quality.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numeric>

#include "tests/core/quality/cell_shapes.h"
#include "tests/support/expect_error.h"

namespace deform::element_quality_test {
namespace {

using namespace test;

TEST(ElementQuality, ReferenceElements) {
  const double volumes[] = {1.0 / 6, 1.0 / 3, 0.5, 1};
  for (const ElementType type : types) {
    SCOPED_TRACE(shape(type).name);
    const ElementQuality q = element_quality(reference(type), one(type));
    EXPECT_NEAR(q.total_volume, volumes[static_cast<int>(type)], 1e-15);
    EXPECT_GT(q.least_scaled_jacobian.value, 0.4);
    EXPECT_EQ(q.inverted_elements, 0u);
    EXPECT_EQ(q.of_type[static_cast<std::size_t>(type)].elements, 1u);
    EXPECT_EQ(q.of_type[static_cast<std::size_t>(type)].total_volume, q.total_volume);
    EXPECT_EQ(q.of_type[(static_cast<std::size_t>(type) + 1) % element_types].elements, 0u);
    EXPECT_NEAR(q.largest_edge_ratio.value,
                type == ElementType::hexahedron ? 1
                : type == ElementType::pyramid  ? std::sqrt(1.5)
                                                : std::sqrt(2),
                1e-12);
  }
  EXPECT_NEAR(element_quality(reference(ElementType::hexahedron), one(ElementType::hexahedron)).least_scaled_jacobian.value, 1,
              1e-15);
  EXPECT_NEAR(element_quality(reference(ElementType::prism), one(ElementType::prism)).least_scaled_jacobian.value, std::sqrt(0.5),
              1e-15);
}

TEST(ElementQuality, KnuppsTetrahedron) {
  const Points regular{{1, 1, 1}, {-1, -1, 1}, {-1, 1, -1}, {1, -1, -1}};
  const ElementQuality q = element_quality(regular, one(ElementType::tetrahedron));
  EXPECT_NEAR(std::abs(q.least_scaled_jacobian.value), std::sqrt(0.5), 1e-15) << "Verdict would say 1";
  EXPECT_NEAR(q.largest_edge_ratio.value, 1, 1e-15);
}

// Every corner sees the same affine map, so its determinant decides.
TEST(ElementQuality, MirroredElementsAreInverted) {
  for (const ElementType type : types) {
    Points points = reference(type);
    for (Vec3& p : points) p[2] = -p[2];
    const ElementQuality q = element_quality(points, one(type));
    EXPECT_LT(q.least_scaled_jacobian.value, 0) << shape(type).name;
    EXPECT_LT(q.total_volume, 0);
    EXPECT_EQ(q.inverted_elements, 1u);
    EXPECT_EQ(std::accumulate(q.histogram.begin(), q.histogram.begin() + ElementQuality::bins / 2, std::size_t{0}), 1u);
  }
}

// The cone formula does not need flat faces: volumes of neighbours with a warped common face add up.
TEST(ElementQuality, VolumesAddUp) {
  Points points = reference(ElementType::hexahedron);
  for (const Vec3& p : reference(ElementType::hexahedron)) {
    if (p[2] > 0.5) points.push_back({p[0], p[1], 2});
  }
  Elements elements = one(ElementType::hexahedron);
  const PointId upper[] = {4, 5, 6, 7, 8, 9, 10, 11};
  elements.add(ElementType::hexahedron, upper);
  points[6][2] = 1.3;
  points[4][2] = 0.8;
  const ElementQuality q = element_quality(points, elements);
  EXPECT_NEAR(q.total_volume, 2, 1e-14);
  EXPECT_GT(q.largest_volume.value - q.least_volume.value, 0.01);
}

/// Not affine, faces warped.
Points bent(Points points) {
  for (Vec3& p : points) p = {p[0] + 0.1 * p[1] * p[2], p[1] - 0.2 * p[0] * p[0], p[2] + 0.15 * p[0] * p[1]};
  return points;
}

TEST(ElementQuality, StraightQuadraticElementsAreLikeLinearOnes) {
  for (const ElementType type : quadratic_types) {
    SCOPED_TRACE(shape(type).name);
    const ElementQuality affine = element_quality(reference(type), one(type));
    const ElementQuality expected = element_quality(reference(linear(type)), one(linear(type)));
    EXPECT_NEAR(affine.total_volume, expected.total_volume, 1e-14);
    EXPECT_NEAR(affine.least_scaled_jacobian.value, expected.least_scaled_jacobian.value, 1e-14);
    EXPECT_NEAR(affine.largest_edge_ratio.value, expected.largest_edge_ratio.value, 1e-14);
    EXPECT_NEAR(affine.largest_aspect_ratio.value, expected.largest_aspect_ratio.value, 1e-13);

    const Points corners = bent(reference(linear(type)));
    const ElementQuality warped = element_quality(with_mid_nodes(type, corners), one(type));
    const ElementQuality flat = element_quality(corners, one(linear(type)));
    EXPECT_NEAR(warped.total_volume, flat.total_volume, 1e-14);
    EXPECT_LE(warped.least_scaled_jacobian.value, flat.least_scaled_jacobian.value + 1e-14);
    EXPECT_GT(warped.least_scaled_jacobian.value, flat.least_scaled_jacobian.value - 0.2);
  }
}

// Every element represents a quadratic map of space exactly: the volume is the integral of its determinant over the straight one.
TEST(ElementQuality, VolumesUnderQuadraticMaps) {
  const std::map<std::size_t, double> integrals_of_x{{4, 1.0 / 24}, {5, 1.0 / 6}, {6, 1.0 / 6}, {8, 0.5}};  // by corners
  for (const ElementType type : quadratic_types) {
    SCOPED_TRACE(shape(type).name);
    const double straight = element_quality(reference(type), one(type)).total_volume;
    Points sheared = reference(type), stretched = sheared;
    for (Vec3& p : sheared) p = {p[0] + 0.2 * p[1] * p[1] - 0.1 * p[1] * p[2], p[1] + 0.3 * p[2] * p[2], p[2]};  // determinant 1
    for (Vec3& p : stretched) p[0] += p[0] * p[0] / 4;                                                           // 1 + x / 2
    EXPECT_NEAR(element_quality(sheared, one(type)).total_volume, straight, 1e-14);
    EXPECT_NEAR(element_quality(stretched, one(type)).total_volume, straight + integrals_of_x.at(shape(type).corners) / 2, 1e-14);
  }
}

TEST(ElementQuality, ShellOfAQuarterCylinder) {
  Points points = reference(ElementType::hexahedron27);
  for (Vec3& p : points) {
    const double r = 1 + p[1], angle = (1 - p[0]) * std::acos(-1) / 2;
    p = {r * std::cos(angle), r * std::sin(angle), p[2]};
  }
  // The arcs are parabolas through ends and middle: half a square, and two thirds of what a segment's box has.
  const double area = (0.5 + 2.0 / 3 * (std::sqrt(2) - 1)) * (2 * 2 - 1 * 1);
  EXPECT_NEAR(element_quality(points, one(ElementType::hexahedron27)).total_volume, area, 1e-13);
  points.resize(20);
  EXPECT_NEAR(element_quality(points, one(ElementType::hexahedron20)).total_volume, area, 1e-13);
}

// Taken as left-handed, a mirrored element has all the numbers of its original.
TEST(ElementQuality, LeftHandedElementsAreMeasuredInAMirror) {
  for (std::size_t i = 0; i < element_types; ++i) {
    const auto type = static_cast<ElementType>(i);
    SCOPED_TRACE(shape(type).name);
    Points points = reference(type), mirrored = points;
    for (std::size_t n = 0; n < points.size(); ++n) mirrored[n][0] = -points[n][0];
    const ElementQuality q = element_quality(points, one(type)), left = element_quality(mirrored, one(type), {1});
    EXPECT_EQ(left.least_scaled_jacobian.value, q.least_scaled_jacobian.value);
    EXPECT_NEAR(left.total_volume, q.total_volume, 1e-15);
    EXPECT_NEAR(left.largest_aspect_ratio.value, q.largest_aspect_ratio.value, 1e-13);
    EXPECT_EQ(left.inverted_elements, 0u);
    EXPECT_EQ(left.left_handed, 1u);
    EXPECT_EQ(element_quality(points, one(type), {1}).inverted_elements, 1u);
  }
}

// A mid node of an edge drawn past a corner turns the element inside out there, which corners alone would not show.
TEST(ElementQuality, MisplacedMidNodesInvert) {
  for (const ElementType type : quadratic_types) {
    SCOPED_TRACE(shape(type).name);
    const ElementShape& form = shape(type);
    for (std::size_t i = 0; i < form.edges.size(); ++i) {
      Points points = reference(type);
      const Vec3 a = points[form.edges[i][0]], b = points[form.edges[i][1]];
      for (std::size_t k = 0; k < 3; ++k) points[form.corners + i][k] = 0.1 * a[k] + 0.9 * b[k];
      EXPECT_EQ(element_quality(points, one(type)).inverted_elements, 1u) << "edge " << i;
      for (std::size_t k = 0; k < 3; ++k) points[form.corners + i][k] = 0.45 * a[k] + 0.55 * b[k];
      EXPECT_EQ(element_quality(points, one(type)).inverted_elements, 0u) << "edge " << i;
    }
    for (std::size_t f = 0; f < form.faces.size(); ++f) {
      if (form.face_centre(f) == ElementShape::no_node) continue;
      Points points = reference(type);
      points[form.face_centre(f)] = points[form.faces[f][0]];
      EXPECT_EQ(element_quality(points, one(type)).inverted_elements, 1u) << "face " << f;
    }
  }
  Points points = reference(ElementType::hexahedron27);
  points[26] = {0.99, 0.5, 0.5};
  EXPECT_EQ(element_quality(points, one(ElementType::hexahedron27)).inverted_elements, 1u);
}

TEST(ElementQuality, MirroredQuadraticElementsAreInverted) {
  for (const ElementType type : quadratic_types) {
    Points points = reference(type);
    for (Vec3& p : points) p[0] = -p[0];
    const ElementQuality q = element_quality(points, one(type));
    EXPECT_EQ(q.inverted_elements, 1u) << shape(type).name;
    EXPECT_LT(q.total_volume, 0);
    EXPECT_EQ(q.largest_aspect_ratio.value, std::numeric_limits<double>::infinity());
  }
}

TEST(ElementQuality, AspectRatios) {
  const auto ratio = [](ElementType type, const Points& points) {
    return element_quality(points, one(type)).largest_aspect_ratio.value;
  };
  EXPECT_NEAR(ratio(ElementType::hexahedron, reference(ElementType::hexahedron)), 1, 1e-15);
  EXPECT_NEAR(ratio(ElementType::tetrahedron, {{1, 1, 1}, {-1, -1, 1}, {-1, 1, -1}, {1, -1, -1}}), std::sqrt(1.5), 1e-14);
  Points flat = reference(ElementType::hexahedron);
  for (Vec3& p : flat) p[1] *= 0.01;
  EXPECT_NEAR(ratio(ElementType::hexahedron, flat), 100, 1e-12);
  // A pyramid of edge 1: height 1 / sqrt(2) over the base, sqrt(2/3) over the sides.
  EXPECT_NEAR(ratio(ElementType::pyramid, {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5, 0.5, std::sqrt(0.5)}}), std::sqrt(2),
              1e-14);
  // Over the sides the height of this one is that of a base edge above the opposite side: 2 sqrt(4/17).
  EXPECT_NEAR(ratio(ElementType::pyramid, {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}, {0, 0, 4}}),
              std::sqrt(18) / (2 * 4 / std::sqrt(17)), 1e-14);
  // An equilateral prism of edge 1 and height 2: longest 2, height sqrt(3)/2.
  const double h = std::sqrt(0.75);
  EXPECT_NEAR(ratio(ElementType::prism, {{0, 0, 0}, {1, 0, 0}, {0.5, h, 0}, {0, 0, 2}, {1, 0, 2}, {0.5, h, 2}}), 2 / h, 1e-14);
}

TEST(ElementQuality, EveryTypeAlone) {
  Points points = reference(ElementType::hexahedron);
  Elements elements = one(ElementType::hexahedron);
  std::vector<PointId> nodes;
  for (Vec3 p : reference(ElementType::tetrahedron10)) {
    nodes.push_back(static_cast<PointId>(points.size()));
    points.push_back({p[0] + 2, p[1], p[2] * 0.5});
  }
  elements.add(ElementType::tetrahedron10, nodes);
  const ElementQuality q = element_quality(points, elements);
  const ElementMeasures& cube = q.of_type[static_cast<std::size_t>(ElementType::hexahedron)];
  const ElementMeasures& tetrahedron = q.of_type[static_cast<std::size_t>(ElementType::tetrahedron10)];
  EXPECT_NEAR(cube.average_scaled_jacobian, 1, 1e-15);
  EXPECT_EQ(cube.largest_aspect_ratio.value, 1);
  EXPECT_NEAR(tetrahedron.total_volume, 1.0 / 12, 1e-15);
  EXPECT_EQ(tetrahedron.least_scaled_jacobian.id, 1u);
  EXPECT_EQ(q.least_scaled_jacobian.value, tetrahedron.least_scaled_jacobian.value);
  EXPECT_NEAR(q.average_scaled_jacobian, (1 + tetrahedron.average_scaled_jacobian) / 2, 1e-15);
  EXPECT_EQ(q.least_edge_ratio.value, 1);
  EXPECT_EQ(q.least_edge_ratio.id, 0u);
  EXPECT_EQ(q.largest_edge_ratio.id, 1u);
}

TEST(ElementQuality, NamesTheWorst) {
  Points points;
  Elements elements;
  for (int e = 0; e < 300; ++e) {
    std::vector<PointId> nodes;
    for (Vec3 p : reference(ElementType::hexahedron)) {
      p[0] += 0.001 * ((e * 37) % 300) * p[2];
      nodes.push_back(static_cast<PointId>(points.size()));
      points.push_back(p);
    }
    elements.add(ElementType::hexahedron, nodes);
  }
  const ElementQuality q = element_quality(points, elements);
  ASSERT_EQ(q.worst.size(), 100u);
  EXPECT_EQ((q.worst[0] * 37) % 300, 299u);
  EXPECT_EQ((q.worst[99] * 37) % 300, 200u);
  EXPECT_EQ(q.least_scaled_jacobian.id, q.worst[0]);
  RunContext single;
  single.threads = 1;
  EXPECT_EQ(element_quality(points, elements, single).average_scaled_jacobian, q.average_scaled_jacobian);
}

TEST(ElementQuality, Refuses) {
  Elements elements = one(ElementType::tetrahedron);
  elements.points[2] = 4;
  test::expect_error(ErrorCode::invalid_argument, {"elements[0]", "point 4"},
                     [&] { element_quality(reference(ElementType::tetrahedron), elements); });
  test::expect_error(ErrorCode::invalid_argument, {"no elements"}, [] { element_quality(Points{{0, 0, 0}}, {}); });
}

}  // namespace
}  // namespace deform::element_quality_test
