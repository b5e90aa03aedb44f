// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform::bench {

/// A sphere around the origin: the faces of an icosahedron divided into n^2 triangles each, 10 n^2 + 2 points. Outward.
Mesh geodesic_sphere(double radius, std::uint32_t n);

/// nx x ny points on [0, width] x [0, height] in the plane z = 0, two triangles per square with alternating diagonals.
Mesh plate(std::size_t nx, std::size_t ny, double width, double height);

/// A thick-walled pipe of hexahedra, bent by a quarter turn: inner radius 0.5, outer radius 1, around a circle of radius 3.
struct Pipe {
  Mesh mesh;                      ///< with elements
  std::vector<PointId> boundary;  ///< ascending
  std::vector<Vec3> change;       ///< where the boundary points go at full change, in their order: displacements
};
Pipe bent_pipe(std::size_t along, std::size_t around, std::size_t through);

/// A closed triangle mesh around something.
struct CageShape {
  std::vector<Vec3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};
CageShape sphere_cage(double radius, std::uint32_t n);
/// The surface of a box, its faces divided into about square cells: counts[k] of them along axis k.
CageShape box_cage(const Vec3& min, const Vec3& max, const std::array<std::size_t, 3>& counts);

}  // namespace deform::bench
