// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <random>
#include <utility>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"

namespace deform::test {

inline constexpr ElementType types[] = {ElementType::tetrahedron, ElementType::pyramid, ElementType::prism,
                                        ElementType::hexahedron};
inline constexpr ElementType quadratic_types[] = {ElementType::tetrahedron10, ElementType::pyramid13, ElementType::pyramid14,
                                                  ElementType::prism15,       ElementType::prism18,   ElementType::hexahedron20,
                                                  ElementType::hexahedron27};

inline ElementType linear(ElementType type) {
  const std::size_t corners = shape(type).corners;
  return corners == 4   ? ElementType::tetrahedron
         : corners == 5 ? ElementType::pyramid
         : corners == 6 ? ElementType::prism
                        : ElementType::hexahedron;
}

/// The nodes of a quadratic element amid those of its linear one.
inline Points with_mid_nodes(ElementType type, Points points) {
  const ElementShape& form = shape(type);
  const auto mean = [&](const std::vector<std::uint8_t>& nodes) {
    Vec3 sum{};
    for (const std::uint8_t node : nodes) {
      for (std::size_t k = 0; k < 3; ++k) sum[k] += points[node][k] / static_cast<double>(nodes.size());
    }
    return sum;
  };
  for (const auto& edge : form.edges) points.push_back(mean({edge[0], edge[1]}));
  points.resize(form.nodes, mean({0, 1, 2, 3, 4, 5, 6, 7}));
  for (std::size_t f = 0; f < form.faces.size(); ++f) {
    const auto& face = form.faces[f];
    if (form.face_centre(f) != ElementShape::no_node) points[form.face_centre(f)] = mean({face[0], face[2], face[4], face[6]});
  }
  return points;
}

/// The reference element of every type: edge 1, positive, straight.
inline Points reference(ElementType type) {
  switch (type) {
    case ElementType::tetrahedron:
      return {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    case ElementType::pyramid:
      return {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5, 0.5, 1}};
    case ElementType::prism:
      return {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}};
    case ElementType::hexahedron:
      return {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
    default:
      return with_mid_nodes(type, reference(linear(type)));
  }
}

inline Elements one(ElementType type) {
  std::vector<PointId> nodes(shape(type).nodes);
  std::iota(nodes.begin(), nodes.end(), 0u);
  Elements elements;
  elements.add(type, nodes);
  return elements;
}

struct Grid {
  Points points;
  PolyhedralCells cells;
};

/// nx x ny x nz cubes of edge 1, internal faces first.
inline Grid grid(std::uint32_t nx, std::uint32_t ny, std::uint32_t nz) {
  Grid grid;
  const auto point = [&](std::uint32_t i, std::uint32_t j, std::uint32_t k) { return i + (nx + 1) * (j + (ny + 1) * k); };
  const auto cell = [&](std::uint32_t i, std::uint32_t j, std::uint32_t k) { return i + nx * (j + ny * k); };
  for (std::uint32_t k = 0; k <= nz; ++k) {
    for (std::uint32_t j = 0; j <= ny; ++j) {
      for (std::uint32_t i = 0; i <= nx; ++i) grid.points.push_back({double(i), double(j), double(k)});
    }
  }
  PolyhedralCells& cells = grid.cells;
  cells.cell_count = std::size_t{nx} * ny * nz;
  const std::uint32_t size[3] = {nx, ny, nz};
  for (const bool internal : {true, false}) {
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      std::uint32_t at[3];
      for (at[2] = 0; at[2] < size[2] + (axis == 2); ++at[2]) {
        for (at[1] = 0; at[1] < size[1] + (axis == 1); ++at[1]) {
          for (at[0] = 0; at[0] < size[0] + (axis == 0); ++at[0]) {
            const bool low = at[axis] == 0, high = at[axis] == size[axis];
            if (internal == (low || high)) continue;
            std::uint32_t corners[4][3];
            for (auto& corner : corners) std::copy(at, at + 3, corner);
            ++corners[1][u], ++corners[2][u], ++corners[2][v], ++corners[3][v];
            for (int c = 0; c < 4; ++c) {
              const auto& corner = corners[low ? 3 - c : c];  // outward
              cells.face_points.push_back(point(corner[0], corner[1], corner[2]));
            }
            cells.face_offsets.push_back(cells.face_points.size());
            std::uint32_t before[3] = {at[0], at[1], at[2]};
            if (!low) --before[axis];
            cells.owner.push_back(cell(before[0], before[1], before[2]));
            if (internal) cells.neighbour.push_back(cell(at[0], at[1], at[2]));
          }
        }
      }
    }
  }
  return grid;
}

/// Every coordinate moved by up to `size`.
inline Points shaken(Points points, double size, std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform(-size, size);
  for (Vec3& p : points) {
    for (double& x : p) x += uniform(random);
  }
  return points;
}

/// Elements of one type, two units apart in rows and layers of `columns`, every third one shaken ten times as much.
inline std::pair<Points, Elements> shaken_elements(ElementType type, int count, int columns, std::mt19937_64& random) {
  Points points;
  Elements elements;
  for (int e = 0; e < count; ++e) {
    std::vector<PointId> nodes;
    for (const Vec3& p : shaken(reference(type), e % 3 == 0 ? 0.2 : 0.02, random)) {
      nodes.push_back(static_cast<PointId>(points.size()));
      points.push_back({p[0] + 2 * (e % columns), p[1] + 2 * (e / columns % columns), p[2] + 2 * (e / (columns * columns))});
    }
    elements.add(type, nodes);
  }
  return {std::move(points), std::move(elements)};
}

}  // namespace deform::test
