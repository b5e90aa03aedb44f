// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

#include "core/base/run_context.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"
#include "core/quality/extreme.h"

namespace deform {

/// Faces of the boundary that are walls, and how large what lies on them is.
struct Wall {
  const Mesh& mesh;                 ///< the boundary
  std::span<const FaceId> faces;    ///< the walls: faces of the boundary
  std::span<const double> volumes;  ///< of the cells or elements of the mesh
};

/// The first layer of cells on a wall.
///
/// Height over a wall face: the volume of its cell over its area, which in a straight prism or hexahedron is the distance to the
/// opposite face and otherwise a mean of it; in a cell with a single corner off the wall face (tetrahedra, pyramids) three times
/// that, the distance of this corner. Negative in an inverted cell. Faces around the mid-face node of a quadratic side are one.
/// Angle at a wall point: between the wall's normal there (the mean of its wall faces, weighted with their areas) and the edge of
/// a cell of the first layer that leaves the wall, from corner to corner; the least of them where several do (tetrahedra). Points
/// from which no edge leaves the wall, as in a corner between two walls, have none.
struct WallQuality {
  std::size_t faces = 0;                 ///< wall faces with a height: all that have an area
  std::size_t points = 0;                ///< points with an angle
  Extreme least_height, largest_height;  ///< id: face of the boundary; of polyhedral cells, face of the cells
  double average_height = 0;             ///< over the faces
  Extreme least_angle, largest_angle;    ///< degrees; id: point
  double average_angle = 0;              ///< over the points
};

/// Both throw Error(invalid_argument) when there is no wall face or one out of range, or there are not as many volumes as cells,
/// cancelled, deadline_exceeded. The result does not depend on the number of threads.
WallQuality wall_quality(const Wall& wall, const PolyhedralCells& cells, const RunContext& context = {});
WallQuality wall_quality(const Wall& wall, const Elements& elements, const RunContext& context = {});

}  // namespace deform
