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

/// The wall faces of a boundary, with the volumes of the cells.
struct Wall {
  const Mesh& mesh;                 ///< the boundary
  std::span<const FaceId> faces;    ///< the walls: faces of the boundary
  std::span<const double> volumes;  ///< volumes of the cells or elements
};

/// Quality measures of the first layer of cells on a wall.
///
/// Height over a wall face: the volume of its cell divided by the area of the face, which is the distance to the opposite face in
/// a straight prism or hexahedron and its mean otherwise. In a cell with a single corner off the wall face (tetrahedra, pyramids)
/// it is three times that, the distance of this corner. Negative in an inverted cell. Faces around the mid-face node of a
/// quadratic side count as one.
///
/// Angle at a wall point: between the normal of the wall (the mean over its wall faces, weighted by area) and the edge, from
/// corner to corner, along which a cell of the first layer leaves the wall; the smallest one if there are several (tetrahedra).
/// Points from which no edge leaves the wall, as in a corner between two walls, have no angle.
struct WallQuality {
  std::size_t faces = 0;      ///< wall faces with a height, that is with an area
  std::size_t points = 0;     ///< points with an angle
  Extreme least_height;       ///< id of the boundary face; for polyhedral cells of the face of the cells
  Extreme largest_height;     ///< the same
  double average_height = 0;  ///< over the faces
  Extreme least_angle;        ///< degrees; id: point
  Extreme largest_angle;      ///< degrees; id: point
  double average_angle = 0;   ///< over the points
};

/// Measure the first layer of cells; the result does not depend on the number of threads. Throw Error(invalid_argument) if there
/// is no wall face, one is out of range, or the number of volumes is not that of cells; cancelled, deadline_exceeded.
WallQuality wall_quality(const Wall& wall, const PolyhedralCells& cells, const RunContext& context = {});
WallQuality wall_quality(const Wall& wall, const Elements& elements, const RunContext& context = {});

}  // namespace deform
