// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/base/plane_sides.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The sides of the symmetry planes of a setup on which its mesh is. Points on a plane slide in it; nothing keeps others on their
/// side. Empty for setups without symmetry planes and for sectors. Throws as Symmetry.
PlaneSides symmetry_sides(const Setup& setup, const Mesh& mesh);

}  // namespace deform
