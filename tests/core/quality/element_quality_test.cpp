// Elements whose measures are known.
#include "core/quality/element_quality.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "tests/support/expect_error.h"

namespace deform {
namespace {

/// The reference element of every type: edge 1, positive.
Points reference(ElementType type) {
  switch (type) {
    case ElementType::tetrahedron:
      return {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    case ElementType::pyramid:
      return {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5, 0.5, 1}};
    case ElementType::prism:
      return {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}};
    case ElementType::hexahedron:
      break;
  }
  return {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
}

constexpr ElementType types[] = {ElementType::tetrahedron, ElementType::pyramid, ElementType::prism, ElementType::hexahedron};

Elements one(ElementType type) {
  std::vector<PointId> nodes(shape(type).nodes);
  std::iota(nodes.begin(), nodes.end(), 0u);
  Elements elements;
  elements.add(type, nodes);
  return elements;
}

TEST(ElementQuality, ReferenceElements) {
  const double volumes[] = {1.0 / 6, 1.0 / 3, 0.5, 1};
  for (const ElementType type : types) {
    SCOPED_TRACE(shape(type).name);
    const ElementQuality q = element_quality(reference(type), one(type));
    EXPECT_NEAR(q.total_volume, volumes[static_cast<int>(type)], 1e-15);
    EXPECT_GT(q.least_scaled_jacobian.value, 0.4);
    EXPECT_EQ(q.inverted_elements, 0u);
    EXPECT_EQ(q.of_type[static_cast<std::size_t>(type)], 1u);
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
}  // namespace deform
