// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The cell to which a boundary face belongs.
struct BoundaryOwner {
  std::uint32_t cell = 0;
  std::uint32_t side = 0;  ///< number of the face in the element's shape; for polyhedral cells the id of the face
};

/// The element of each face of a boundary mesh. Faces around the mid-face node of a quadratic side have the same owner. Throws
/// Error(invalid_argument) naming a face that belongs to no element.
std::vector<BoundaryOwner> boundary_owners(const Mesh& boundary, const Elements& elements);

/// The cell of each face of a boundary mesh, which consists of the faces of the cells that follow the internal ones. Throws
/// Error(invalid_argument) if their numbers differ.
std::vector<BoundaryOwner> boundary_owners(const Mesh& boundary, const PolyhedralCells& cells);

}  // namespace deform
