// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <vector>

#include "core/mesh/mesh.h"

namespace deform::cad {

/// The faces of a mesh as triangles, with their orientation. A polygon is the fan around its first corner; a face of a quadratic
/// element is a triangle at each corner with the mid-edge nodes next to it, and the fan of the mid-edge nodes.
std::vector<std::array<PointId, 3>> boundary_triangles(const Mesh& mesh);

}  // namespace deform::cad
