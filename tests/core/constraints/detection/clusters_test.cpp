// SPDX-License-Identifier: GPL-3.0-or-later
// Clusters of faces, and detection over them on fine meshes.
#include "core/constraints/detection/clusters.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "tests/core/constraints/detection/expect_found.h"
#include "tests/core/constraints/detection/parts.h"

namespace deform::clusters_test {
namespace {

using detection::Clusters;
using detection::Surface;
using test::expect_found;
using test::Kind;
using test::Part;

constexpr double maximum_angle = 0.6;

/// Every face is in one cluster, that of its list.
void expect_partition(const Clusters& clusters, std::size_t faces) {
  ASSERT_EQ(clusters.order.size(), faces);
  ASSERT_EQ(clusters.begin.back(), faces);
  std::vector<int> uses(faces, 0);
  for (std::size_t c = 0; c < clusters.count(); ++c) {
    ASSERT_FALSE(clusters.faces(c).empty());
    for (const FaceId f : clusters.faces(c)) {
      ++uses[f];
      EXPECT_EQ(clusters.cluster_of[f], c);
    }
  }
  EXPECT_EQ(std::count(uses.begin(), uses.end(), 1), static_cast<std::ptrdiff_t>(faces));
}

/// Pieces that remain when only faces of one cluster are joined: as many as clusters.
std::size_t pieces(const Surface& surface, const Clusters& clusters) {
  std::vector<char> seen(surface.face_count(), 0);
  std::size_t count = 0;
  for (std::size_t start = 0; start < seen.size(); ++start) {
    if (seen[start]) continue;
    seen[start] = 1;
    ++count;
    std::vector<FaceId> front{static_cast<FaceId>(start)};
    while (!front.empty()) {
      const FaceId f = front.back();
      front.pop_back();
      for (const FaceId n : surface.passages(f)) {
        if (seen[n] || clusters.cluster_of[n] != clusters.cluster_of[f]) continue;
        seen[n] = 1;
        front.push_back(n);
      }
    }
  }
  return count;
}

TEST(Clusters, AreConnectedSmallAndNearlyFlat) {
  for (const Part& part : {test::filleted_shaft(6), test::rounded_block(5), test::torus(4)}) {
    SCOPED_TRACE(part.name);
    Surface surface(part.mesh, {});
    surface.find_passages(maximum_angle);
    const double largest = surface.total_area / 2000;
    const Clusters clusters(surface, largest);
    expect_partition(clusters, surface.face_count());
    EXPECT_EQ(pieces(surface, clusters), clusters.count());
    EXPECT_LT(2 * clusters.count(), surface.face_count());
    for (std::size_t c = 0; c < clusters.count(); ++c) {
      const auto faces = clusters.faces(c);
      double area = 0;
      for (const FaceId f : faces) {
        area += surface.area[f];
        EXPECT_GE(surface.normal[f].dot(surface.normal[faces[0]]), std::cos(maximum_angle / 4 + 1e-6));
      }
      EXPECT_NEAR(clusters.surface.area[c], area, 1e-12);
      EXPECT_TRUE(faces.size() == 1 || area <= largest);
    }
    EXPECT_NEAR(std::accumulate(clusters.surface.area.begin(), clusters.surface.area.end(), 0.0), surface.total_area, 1e-9);
  }
}

TEST(Clusters, AreNeighboursWhereFacesPass) {
  const Part part = test::cube(12);
  Surface surface(part.mesh, {});
  surface.find_passages(maximum_angle);
  const Clusters clusters(surface, surface.total_area / 200);
  for (std::size_t c = 0; c < clusters.count(); ++c) {
    std::vector<FaceId> expected;
    for (const FaceId f : clusters.faces(c)) {
      for (const FaceId n : surface.passages(f)) {
        if (clusters.cluster_of[n] != c) expected.push_back(clusters.cluster_of[n]);
      }
    }
    std::sort(expected.begin(), expected.end());
    expected.erase(std::unique(expected.begin(), expected.end()), expected.end());
    std::vector<FaceId> found(clusters.surface.passages(c).begin(), clusters.surface.passages(c).end());
    std::sort(found.begin(), found.end());
    EXPECT_EQ(found, expected);
    // Not around the edges of the cube.
    for (const FaceId n : found) {
      EXPECT_GT(clusters.surface.normal[n].dot(clusters.surface.normal[c]), 0.99);
    }
  }
}

TEST(Clusters, TakeFacesWithoutAreaAlong) {
  Part part = test::cube(6);
  Mesh& mesh = part.mesh;
  // A fold of no area beside a face, and one on its own.
  mesh.face_sizes.insert(mesh.face_sizes.end(), {3, 3});
  const PointId a = mesh.face_points[0], b = mesh.face_points[1];
  const auto alone = static_cast<PointId>(mesh.points.size());
  mesh.points.insert(mesh.points.end(), {{0, 0, 2}, {0, 0, 3}});
  mesh.face_points.insert(mesh.face_points.end(), {a, b, b, alone, alone + 1, alone + 1});
  Surface surface(mesh, {});
  surface.find_passages(maximum_angle);
  const Clusters clusters(surface, surface.total_area / 50);
  expect_partition(clusters, surface.face_count());
  EXPECT_EQ(clusters.faces(clusters.cluster_of[surface.face_count() - 1]).size(), 1u);
}

/// All but the torus, whose flat top and bottom are within the tolerance of planes.
std::vector<Part> fine_parts() {
  return {test::cube(90),    test::plate_with_hole(20), test::capped_cylinder(19), test::dome(18),
          test::frustum(20), test::step_shaft(14),      test::filleted_shaft(12),  test::rounded_block(10)};
}

/// Normal noise of that standard deviation over the diagonal, in every coordinate.
void shake(Mesh& mesh, double level) {
  const double deviation = level * bounding_box(mesh.points).diagonal();
  std::mt19937_64 engine(7);
  std::normal_distribution<double> normal(0, deviation);
  for (Vec3& p : mesh.points) {
    for (double& x : p) x += normal(engine);
  }
}

TEST(FineMeshes, HaveTheirPrimitivesFoundExactly) {
  for (const Part& part : fine_parts()) {
    ASSERT_GT(part.mesh.face_count(), 80000u) << part.name;
    expect_found(part, detect(part.mesh, {}), part.name, 1e-6);
  }
}

TEST(FineMeshes, HaveTheirPrimitivesFoundInNoise) {
  for (Part& part : fine_parts()) {
    if (part.name == "filleted_shaft") continue;  // of its fillet, 3 % of the faces are within the noise of what it runs into
    shake(part.mesh, 1e-4);
    expect_found(part, detect(part.mesh, {}), part.name, 5e-3);
  }
}

TEST(FineMeshes, GiveTheSameForAnyNumberOfThreads) {
  Part part = test::filleted_shaft(12);
  shake(part.mesh, 1e-4);
  RunContext one, two;
  one.threads = 1;
  two.threads = 2;
  const Detection a = detect(part.mesh, {}, one), b = detect(part.mesh, {}, two);
  ASSERT_EQ(a.primitives.size(), b.primitives.size());
  for (std::size_t i = 0; i < a.primitives.size(); ++i) {
    EXPECT_EQ(a.primitives[i].faces, b.primitives[i].faces) << i;
    EXPECT_EQ(a.primitives[i].point, b.primitives[i].point) << i;
    EXPECT_EQ(a.primitives[i].radius, b.primitives[i].radius) << i;
  }
}

}  // namespace
}  // namespace deform::clusters_test
