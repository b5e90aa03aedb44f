// SPDX-License-Identifier: GPL-3.0-or-later
// Cages for tests, and points in, on and around them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include "core/base/vectors.h"
#include "core/numerics/cage/cage.h"

namespace deform::test {

struct CageMesh {
  std::vector<Vec3> vertices;
  std::vector<Cage::Triangle> triangles;
  Cage cage() const { return {vertices, triangles}; }
};

/// A prism over a polygon in the plane z = 0 that is star-shaped from its first corner, corners in counter-clockwise order.
inline CageMesh prism(const std::vector<Vec3>& polygon, double height) {
  CageMesh mesh;
  const auto n = static_cast<std::uint32_t>(polygon.size());
  mesh.vertices = polygon;
  for (const Vec3& x : polygon) mesh.vertices.push_back({x[0], x[1], height});
  for (std::uint32_t k = 0; k < n; ++k) {
    const std::uint32_t next = (k + 1) % n;
    mesh.triangles.push_back({k, next, n + next});
    mesh.triangles.push_back({k, n + next, n + k});
    if (k == 0 || next == 0) continue;
    mesh.triangles.push_back({0, next, k});
    mesh.triangles.push_back({n, n + k, n + next});
  }
  return mesh;
}

inline CageMesh box_cage(const Vec3& low, const Vec3& high) {
  CageMesh mesh = prism({{low[0], low[1], 0}, {high[0], low[1], 0}, {high[0], high[1], 0}, {low[0], high[1], 0}}, 1);
  for (Vec3& x : mesh.vertices) x[2] = x[2] == 0 ? low[2] : high[2];
  return mesh;
}

/// Planes of its faces run through its inside.
inline CageMesh l_cage() { return prism({{1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, -1, 0}, {2, -1, 0}, {2, 0, 0}}, 0.7); }

/// A torus of columns x rows vertices whose radius is random: not convex, genus 1.
inline CageMesh bumpy_torus(std::uint32_t columns, std::uint32_t rows, unsigned seed) {
  CageMesh mesh;
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> radius(0.3, 0.7);
  for (std::uint32_t i = 0; i < columns; ++i) {
    for (std::uint32_t j = 0; j < rows; ++j) {
      const double u = 2 * std::numbers::pi * i / columns, v = 2 * std::numbers::pi * j / rows, r = radius(random);
      const double out = 1.2 + r * std::cos(v);
      mesh.vertices.push_back({out * std::cos(u), out * std::sin(u), r * std::sin(v)});
      const std::uint32_t a = i * rows + j, b = (i + 1) % columns * rows + j;
      const std::uint32_t c = (i + 1) % columns * rows + (j + 1) % rows, d = i * rows + (j + 1) % rows;
      mesh.triangles.push_back({a, b, c});
      mesh.triangles.push_back({a, c, d});
    }
  }
  return mesh;
}

/// In the box of the cage, one half longer on each side; on faces, edges and vertices; beside faces in their planes and near
/// them.
inline std::vector<Vec3> points_around(const Cage& cage, std::size_t count, unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform;
  const Box box = bounding_box(cage.vertices());
  std::vector<Vec3> points = cage.vertices();
  const auto corner = [&](const Cage::Face& face, std::size_t k) { return cage.vertices()[face.corners[k]]; };
  while (points.size() < count) {
    const Cage::Face& face = cage.faces()[random() % cage.faces().size()];
    const double a = uniform(random), b = uniform(random), h = std::pow(10.0, -16 * uniform(random));
    const Vec3 edge = lerp(corner(face, 0), corner(face, 1), a);
    const Vec3 inner = lerp(edge, corner(face, 2), b), beside = lerp(edge, corner(face, 2), 3 * b - 1);
    for (const Vec3& x : {edge, inner, beside, inner + h * face.normal, inner - h * face.normal, beside + h * face.normal,
                          edge + h * face.normal, lerp(corner(face, 0), corner(face, 1), 3 * a - 1)}) {
      points.push_back(x);
    }
    for (int i = 0; i < 8; ++i) {
      Vec3 x{};
      for (int k = 0; k < 3; ++k) x[k] = box.min[k] + box.side(k) * (2 * uniform(random) - 0.5);
      points.push_back(x);
    }
  }
  return points;
}

}  // namespace deform::test
