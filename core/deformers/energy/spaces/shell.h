// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/energy/spaces/energy_space.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The thin shell (thesis 3.1, 8.2) with K = -gamma_s L_s + gamma_b L_s M^-1 L_s: L_s is the integrated cotangent Laplacian and M
/// the mixed Voronoi areas, both for all points, so that soft handles converge to hard ones as their weight grows.
///  - Hard handles: one function per deformable point. The system is eq. 3.4 times M, symmetric positive definite. Only held
///    points within two rings of the deformable points enter; the others have no influence.
///  - Soft handles: one function per point (eq. 8.9, 8.10 without the last term).
/// Throws Error(invalid_argument) for deformable points without a face, and for components of the surface without handle or fixed
/// points (with their number and the first point), and the errors of RunContext::check().
EnergyModel shell_model(const Mesh& mesh, const std::vector<RegionIndex>& region_of, const ShellOptions& options, double diagonal,
                        const RunContext& context = {});

}  // namespace deform
