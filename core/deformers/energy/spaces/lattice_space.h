// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/energy/spaces/energy_space.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// Free-form deformation as an energy space (thesis 3.2): the functions are the splines of the control points, computed
/// on demand. The energy gamma_s |grad d|^2 + gamma_b |hessian d|^2 is integrated exactly over the whole lattice, as
/// sums of products of Gram matrices along the axes. Only affine displacements have zero bending energy. Throws the
/// errors of model_lattice().
EnergyModel lattice_model(const Mesh& mesh, const FfdOptions& options, const std::vector<RegionIndex>& region_of,
                          const RunContext& context);

}  // namespace deform
