// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/segment_crossings.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "core/base/vectors.h"
#include "tests/core/quality/surface_meshes.h"

namespace deform::segment_crossings_test {
namespace {

/// By the signs of volumes of tetrahedra, over all triangles.
std::vector<double> by_volumes(const Mesh& mesh, const Vec3& a, const Vec3& b) {
  const auto volume = [](const Vec3& p, const Vec3& q, const Vec3& r, const Vec3& s) { return dot(cross(q - p, r - p), s - p); };
  std::vector<double> result;
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    const PointId* const c = mesh.face_points.data() + 3 * f;
    const Vec3 &p = mesh.points[c[0]], &q = mesh.points[c[1]], &r = mesh.points[c[2]];
    const double from = volume(p, q, r, a), to = volume(p, q, r, b);
    if ((from > 0) == (to > 0)) continue;
    const bool first = volume(a, b, p, q) > 0;
    if (first == (volume(a, b, q, r) > 0) && first == (volume(a, b, r, p) > 0)) result.push_back(from / (from - to));
  }
  std::sort(result.begin(), result.end());
  return result;
}

TEST(SegmentCrossings, AreThoseOfAllTriangles) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-1.2, 1.2);
  std::size_t most = 0;
  for (const Mesh& mesh : {test::sphere(1, 4), test::tube(0.7, 40, 20, 1.1, test::Faces::triangles)}) {
    const SegmentCrossings crossings(mesh, mesh.points);
    std::vector<double> found;
    for (int i = 0; i < 1000; ++i) {
      const Vec3 a{uniform(random), uniform(random), uniform(random)}, b{uniform(random), uniform(random), uniform(random)};
      crossings.along(a, b, found);
      const std::vector<double> expected = by_volumes(mesh, a, b);
      ASSERT_EQ(found.size(), expected.size()) << i;
      for (std::size_t k = 0; k < found.size(); ++k) EXPECT_NEAR(found[k], expected[k], 1e-9);
      most = std::max(most, found.size());
    }
  }
  EXPECT_EQ(most, 2u);
}

TEST(SegmentCrossings, AlongAxesAndWithoutFaces) {
  const Mesh mesh = test::sheet(4, 4, test::Faces::quads, [](unsigned i, unsigned j) { return Vec3{1.0 * i, 1.0 * j, 0}; });
  const SegmentCrossings crossings(mesh, mesh.points);
  std::vector<double> found;
  crossings.along({1.3, 2.6, -1}, {1.3, 2.6, 3}, found);
  EXPECT_EQ(found, std::vector<double>{0.25});
  crossings.along({1.3, 2.6, 1}, {1.3, 2.6, 3}, found);
  EXPECT_TRUE(found.empty());
  crossings.along({-1, 2.6, 1}, {9, 2.6, 1}, found);
  EXPECT_TRUE(found.empty());
  SegmentCrossings(Mesh{}, {}).along({0, 0, 0}, {1, 1, 1}, found);
  EXPECT_TRUE(found.empty());
}

}  // namespace
}  // namespace deform::segment_crossings_test
