// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>
#include <initializer_list>
#include <map>
#include <numbers>

#include "core/mesh/mesh.h"

namespace deform::test {

inline void add_face(Mesh& mesh, std::initializer_list<PointId> corners) {
  mesh.face_sizes.push_back(static_cast<std::uint32_t>(corners.size()));
  mesh.face_points.insert(mesh.face_points.end(), corners);
}

enum class Faces { quads, triangles };

/// (columns + 1) x (rows + 1) points at place(column, row), row by row; faces counter-clockwise in the plane of (column, row).
template <typename Place>
Mesh sheet(std::uint32_t columns, std::uint32_t rows, Faces faces, const Place& place) {
  Mesh mesh;
  for (std::uint32_t j = 0; j <= rows; ++j) {
    for (std::uint32_t i = 0; i <= columns; ++i) mesh.points.push_back(place(i, j));
  }
  for (std::uint32_t j = 0; j < rows; ++j) {
    for (std::uint32_t i = 0; i < columns; ++i) {
      const PointId a = i + (columns + 1) * j, b = a + 1, c = b + columns + 1, d = c - 1;
      if (faces == Faces::quads) {
        add_face(mesh, {a, b, c, d});
      } else {
        add_face(mesh, {a, b, c});
        add_face(mesh, {a, c, d});
      }
    }
  }
  return mesh;
}

/// An open tube of `around` strips around the z axis, closed in itself around.
inline Mesh tube(double radius, std::uint32_t around, std::uint32_t rows, double height, Faces faces) {
  Mesh mesh;
  for (std::uint32_t j = 0; j <= rows; ++j) {
    for (std::uint32_t i = 0; i < around; ++i) {
      const double angle = 2 * std::numbers::pi * i / around;
      mesh.points.push_back({radius * std::cos(angle), radius * std::sin(angle), height * j / rows});
    }
  }
  for (std::uint32_t j = 0; j < rows; ++j) {
    for (std::uint32_t i = 0; i < around; ++i) {
      const PointId a = i + around * j, b = (i + 1) % around + around * j, c = b + around, d = a + around;
      if (faces == Faces::quads) {
        add_face(mesh, {a, b, c, d});
      } else {
        add_face(mesh, {a, b, c});
        add_face(mesh, {a, c, d});
      }
    }
  }
  return mesh;
}

/// An octahedron whose triangles were split in four `level` times, its points on a sphere around the origin.
inline Mesh sphere(double radius, int level) {
  Mesh mesh;
  mesh.points = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  const PointId corners[8][3] = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (const auto& c : corners) add_face(mesh, {c[0], c[1], c[2]});
  const auto project = [](Vec3 p) {
    const double length = std::hypot(p[0], p[1], p[2]);
    for (double& x : p) x /= length;
    return p;
  };
  for (int l = 0; l < level; ++l) {
    std::map<std::pair<PointId, PointId>, PointId> middles;
    const auto middle = [&](PointId a, PointId b) {
      const auto [entry, added] = middles.try_emplace(std::minmax(a, b), static_cast<PointId>(mesh.points.size()));
      if (added) {
        const Vec3 &p = mesh.points[a], &q = mesh.points[b];
        mesh.points.push_back(project({p[0] + q[0], p[1] + q[1], p[2] + q[2]}));
      }
      return entry->second;
    };
    const std::vector<PointId> old = std::move(mesh.face_points);
    mesh.face_points.clear();
    mesh.face_sizes.clear();
    for (std::size_t f = 0; f < old.size(); f += 3) {
      const PointId a = old[f], b = old[f + 1], c = old[f + 2], ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      add_face(mesh, {a, ab, ca});
      add_face(mesh, {ab, b, bc});
      add_face(mesh, {ca, bc, c});
      add_face(mesh, {ab, bc, ca});
    }
  }
  for (Vec3& p : mesh.points) {
    for (double& x : p) x *= radius;
  }
  return mesh;
}

}  // namespace deform::test
