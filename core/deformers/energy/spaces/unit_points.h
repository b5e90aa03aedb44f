// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/deformers/energy/spaces/energy_space.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The unit coordinates of a mesh: from the least corner of its bounding box, divided by the diagonal of that. They do not depend
/// on where the mesh is, so that nothing that is chosen in them does. Throws Error(invalid_argument) if all points coincide.
UnitBox unit_box(const Mesh& mesh);
/// The points of a mesh in these.
std::vector<Vec3> unit_points(const Mesh& mesh);

/// The coefficients of moving least squares that reproduce 1, x, y, z, that is their values at the samples: k x 4.
SparseMatrix linear_coefficients(const std::vector<Vec3>& samples);

}  // namespace deform
