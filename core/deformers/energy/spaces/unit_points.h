// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/deformers/energy/spaces/energy_space.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The points of a mesh divided by the diagonal of their bounding box. Throws Error(invalid_argument) if all coincide.
std::vector<Vec3> unit_points(const Mesh& mesh);

/// The coefficients of moving least squares that reproduce 1, x, y, z, that is their values at the samples: k x 4.
SparseMatrix linear_coefficients(const std::vector<Vec3>& samples);

}  // namespace deform
