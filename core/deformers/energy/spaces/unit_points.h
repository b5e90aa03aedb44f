// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/deformers/energy/spaces/energy_space.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The points of a mesh divided by the diagonal of their box. Throws Error(invalid_argument) when all coincide.
std::vector<Vec3> unit_points(const Mesh& mesh);

/// k x 4: coefficients of moving least squares that reproduce 1, x, y, z, which are the values at the samples.
SparseMatrix linear_coefficients(const std::vector<Vec3>& samples);

}  // namespace deform
