// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/mesh/cages/cage_around.h"
#include "core/mesh/cages/mirror_frame.h"
#include "core/mesh/cages/offset_surface.h"
#include "core/mesh/inspect.h"
#include "core/mesh/mesh.h"
#include "core/mesh/remeshing/isotropic_remeshing.h"

namespace deform::test {

/// The solid angle that all triangles take in at x, one after the other, over 4 pi.
inline double winding_of(const Mesh& mesh, const Vec3& x) {
  double sum = 0;
  for (std::size_t c = 0; c < mesh.face_points.size(); c += 3) {
    const Vec3 a = mesh.points[mesh.face_points[c]] - x, b = mesh.points[mesh.face_points[c + 1]] - x,
               d = mesh.points[mesh.face_points[c + 2]] - x;
    const double la = norm(a), lb = norm(b), ld = norm(d);
    sum += 2 * std::atan2(dot(a, cross(b, d)), la * lb * ld + dot(a, b) * ld + dot(b, d) * la + dot(d, a) * lb);
  }
  return sum / (4 * std::numbers::pi);
}

inline std::size_t outside_of(const Mesh& cage, const Points& points) {
  return static_cast<std::size_t>(
      std::count_if(points.begin(), points.end(), [&](const Vec3& x) { return !(winding_of(cage, x) > 0.5); }));
}

/// Every edge is run along once in each direction.
inline void expect_closed(const Mesh& mesh) {
  std::set<std::pair<PointId, PointId>> directed;
  for (std::size_t c = 0; c < mesh.face_points.size(); c += 3) {
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_TRUE(directed.emplace(mesh.face_points[c + k], mesh.face_points[c + (k + 1) % 3]).second);
    }
  }
  for (const auto& [a, b] : directed) ASSERT_TRUE(directed.count({b, a}) == 1) << "edge " << a << "-" << b << " is open";
}

/// The smallest angle by the law of cosines, degrees.
inline double least_angle_of(const Mesh& mesh) {
  double largest_cosine = -1;
  for (std::size_t c = 0; c < mesh.face_points.size(); c += 3) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 &x = mesh.points[mesh.face_points[c + k]], &y = mesh.points[mesh.face_points[c + (k + 1) % 3]],
                 &z = mesh.points[mesh.face_points[c + (k + 2) % 3]];
      const double a = distance(y, z), b = distance(z, x), d = distance(x, y);
      largest_cosine = std::max(largest_cosine, (b * b + d * d - a * a) / (2 * b * d));
    }
  }
  return std::acos(largest_cosine) * 180 / std::numbers::pi;
}

/// Everything that is promised of a cage, by other code than that which made it.
inline void expect_cage(const CageAround& cage, const Mesh& model, std::size_t points) {
  expect_closed(cage.mesh);
  const MeshReport report = inspect(cage.mesh);
  EXPECT_EQ(report.non_manifold_points + report.degenerate_faces + report.isolated_points, 0u);
  EXPECT_EQ(cage.components, report.components);
  EXPECT_EQ(report.points + report.faces + 2 * cage.genus, report.edges + 2 * report.components);
  EXPECT_NEAR(static_cast<double>(report.points), static_cast<double>(points), 0.05 * static_cast<double>(points));
  EXPECT_GE(least_angle_of(cage.mesh), 15);
  EXPECT_NEAR(least_angle_of(cage.mesh), cage.least_angle, 1e-6);
  EXPECT_EQ(outside_of(cage.mesh, model.points), 0u);
  EXPECT_GE(cage.clearance, 0.0999 * cage.offset);
}

/// The triangles whose corners are all at `least` or more along an axis. All points stay.
inline Mesh part_above(const Mesh& mesh, std::size_t axis, double least) {
  Mesh part;
  part.points = mesh.points;
  for (std::size_t c = 0; c < mesh.face_points.size(); c += 3) {
    const auto at = [&](std::size_t corner) { return mesh.points[mesh.face_points[c + corner]][axis]; };
    if (std::min({at(0), at(1), at(2)}) < least) continue;
    part.face_sizes.push_back(3);
    for (std::size_t k = 0; k < 3; ++k) part.face_points.push_back(mesh.face_points[c + k]);
  }
  return part;
}

/// Wraps triangles and their mirror images in the plane x = 0 and checks that what comes out of the remeshing can be cut there:
/// the part on one side is open where it lies in the plane and nowhere else, and closed by its image.
inline void expect_cut(const Mesh& model, double offset, std::size_t vertices) {
  SCOPED_TRACE(testing::Message() << offset << ", " << vertices);
  std::vector<TriangleCorners> triangles;
  Box box;
  for (std::size_t c = 0; c < model.face_points.size(); c += 3) {
    TriangleCorners own{}, image{};
    for (std::size_t k = 0; k < 3; ++k) {
      own[k] = image[k] = model.points[model.face_points[c + k]];
      image[k][0] = -image[k][0];
      box.add(own[k]);
      box.add(image[k]);
    }
    triangles.push_back(own);
    triangles.push_back(image);
  }
  const Mesh half = offset_surface(ClosestPoint(triangles), box, {offset, offset / 2, 1});
  const SurfaceMesh made =
      isotropic_remeshing(SurfaceMesh(with_images(half, 1)), {.vertices = vertices, .feature_degrees = 180, .planes = 1});
  const SurfaceMesh part(part_beyond(made.to_mesh(), 1));
  part.check();
  std::size_t cut = 0;
  for (const EdgeHandle e : part.edges()) {
    const HalfedgeHandle h = SurfaceMesh::halfedge(e);
    const double a = part.point(part.source(h))[0], b = part.point(part.target(h))[0];
    ASSERT_GE(std::min(a, b), 0);
    EXPECT_EQ(part.is_boundary(e), a == 0 && b == 0);
    cut += part.is_boundary(e) ? 1 : 0;
  }
  EXPECT_GE(cut, 3u);
  expect_closed(with_images(part.to_mesh(), 1));
}

}  // namespace deform::test
