// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <utility>

#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"
#include "tests/core/deformers/shapes.h"

namespace deform::test {

/// [0, 1]^2 in n x n quads, in the plane z = 0.
inline Mesh square(std::size_t n) {
  Mesh mesh;
  const auto at = [&](std::size_t i, std::size_t j) { return static_cast<PointId>(i + (n + 1) * j); };
  for (std::size_t j = 0; j <= n; ++j) {
    for (std::size_t i = 0; i <= n; ++i) {
      mesh.points.push_back(
          {static_cast<double>(i) / static_cast<double>(n), static_cast<double>(j) / static_cast<double>(n), 0});
    }
  }
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t i = 0; i < n; ++i) {
      mesh.face_sizes.push_back(4);
      mesh.face_points.insert(mesh.face_points.end(), {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return mesh;
}

/// The surface of the cubes (i, j, k) of a grid for which `full` holds, of the given edge.
template <typename Full>
inline Mesh cubes(const std::array<int, 3>& counts, double edge, const Full& full) {
  Mesh mesh;
  std::map<std::array<int, 3>, PointId> ids;
  const auto corner = [&](const std::array<int, 3>& at) {
    const auto [entry, added] = ids.try_emplace(at, static_cast<PointId>(mesh.points.size()));
    if (added) mesh.points.push_back({edge * at[0], edge * at[1], edge * at[2]});
    return entry->second;
  };
  const auto is_full = [&](const std::array<int, 3>& at) {
    for (std::size_t k = 0; k < 3; ++k) {
      if (at[k] < 0 || at[k] >= counts[k]) return false;
    }
    return full(at[0], at[1], at[2]);
  };
  for (int i = 0; i < counts[0]; ++i) {
    for (int j = 0; j < counts[1]; ++j) {
      for (int k = 0; k < counts[2]; ++k) {
        const std::array<int, 3> at{i, j, k};
        if (!is_full(at)) continue;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          for (const int side : {0, 1}) {
            std::array<int, 3> beside = at;
            beside[axis] += side == 0 ? -1 : 1;
            if (is_full(beside)) continue;
            const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
            std::array<std::array<int, 3>, 4> corners;
            corners.fill(at);
            for (auto& c : corners) c[axis] += side;
            corners[1][u] += 1;
            corners[2][u] += 1;
            corners[2][v] += 1;
            corners[3][v] += 1;
            if (side == 0) std::swap(corners[1], corners[3]);
            mesh.face_sizes.push_back(4);
            for (const auto& c : corners) mesh.face_points.push_back(corner(c));
          }
        }
      }
    }
  }
  return mesh;
}

/// [0, 1]^3 in n x n x n hexahedra; the faces of the mesh are those of the boundary.
struct Cube {
  Mesh mesh;
  Elements elements;
};

inline Cube cube(std::size_t n) {
  Cube cube;
  const auto share = [&](std::size_t i) { return static_cast<double>(i) / static_cast<double>(n); };
  const auto at = [&](std::size_t i, std::size_t j, std::size_t k) {
    return static_cast<PointId>(i + (n + 1) * (j + (n + 1) * k));
  };
  for (std::size_t k = 0; k <= n; ++k) {
    for (std::size_t j = 0; j <= n; ++j) {
      for (std::size_t i = 0; i <= n; ++i) cube.mesh.points.push_back({share(i), share(j), share(k)});
    }
  }
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t j = 0; j < n; ++j) {
      for (std::size_t i = 0; i < n; ++i) {
        const PointId nodes[] = {at(i, j, k),     at(i + 1, j, k),     at(i + 1, j + 1, k),     at(i, j + 1, k),
                                 at(i, j, k + 1), at(i + 1, j, k + 1), at(i + 1, j + 1, k + 1), at(i, j + 1, k + 1)};
        cube.elements.add(ElementType::hexahedron, nodes);
      }
    }
  }
  BoundaryFaces boundary = boundary_faces(cube.elements);
  cube.mesh.face_sizes = std::move(boundary.sizes);
  cube.mesh.face_points = std::move(boundary.points);
  return cube;
}

/// The sides of [0, 1]^2 or 3 stay, what lies within 0.1 of the middle in x and y is the handle "block"; in three dimensions the
/// sides below and above stay too.
inline Setup block_setup(int dimensions) {
  Setup setup;
  setup.method = RbfOptions{.kernel = Kernel::triharmonic};
  const double low = dimensions == 3 ? 0.4 : -1, high = dimensions == 3 ? 0.6 : 1;
  setup.handles = {{"block", box({0.399, 0.399, low - 0.001}, {0.601, 0.601, high + 0.001})}};
  const auto side = [](int axis, double at) {
    Vec3 min{-1, -1, -1}, max{2, 2, 2};
    const auto k = static_cast<std::size_t>(axis);
    min[k] = at - 1e-9;
    max[k] = at + 1e-9;
    return box(min, max);
  };
  for (int axis = 0; axis < dimensions; ++axis) {
    setup.fixed.push_back(side(axis, 0));
    setup.fixed.push_back(side(axis, 1));
  }
  return setup;
}

/// The block turned about the axis z through the middle, then shifted.
inline Design moved_block(double angle, const Vec3& shift) {
  const double c = std::cos(angle), s = std::sin(angle);
  const Affine motion{c, -s, 0,       0.5 - 0.5 * c + 0.5 * s + shift[0], s, c, 0, 0.5 - 0.5 * s - 0.5 * c + shift[1], 0,
                      0, 1,  shift[2]};
  return {{}, {{0, motion}}};
}

}  // namespace deform::test
