// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The cell that a face of the boundary belongs to.
struct BoundaryOwner {
  std::uint32_t cell = 0;
  std::uint32_t side = 0;  ///< number of the face in the element's shape; of polyhedral cells the face
};

/// For every face of a boundary mesh its element. Faces around the mid-face node of a quadratic side have the same owner. Throws
/// Error(invalid_argument) naming a face that belongs to none.
std::vector<BoundaryOwner> boundary_owners(const Mesh& boundary, const Elements& elements);

/// For every face of a boundary mesh, which are the faces of the cells behind the internal ones, its cell. Throws
/// Error(invalid_argument) when there are not as many.
std::vector<BoundaryOwner> boundary_owners(const Mesh& boundary, const PolyhedralCells& cells);

}  // namespace deform
