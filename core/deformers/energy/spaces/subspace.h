// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/base/run_context.h"
#include "core/deformers/energy/spaces/energy_space.h"
#include "core/deformers/energy/spaces/mls.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The shell's energy on the mesh over few functions in space (thesis 8.3, eq. 8.11): K = Phi^T E Phi with E = -gamma_s L +
/// gamma_b L M^-1 L of shell_operators(), all in unit coordinates. Centres are spread over the faces (8.3, figure 8.2).
///  - without a kernel: linear moving least squares (8.3.3); reproduces linear motions.
///  - kernels that decay: cut off at the radius that the cover asks for (8.3.2), see KernelProperties::local_shape.
///  - kernels without a shape, such as r^3 and r (8.3.1). Full matrices, and as they stand hopelessly dependent (thesis: they
///  "fail" for
///    stretching: the Cholesky factorization of Phi^T E Phi breaks down); so the functions are replaced by combinations that are
///    orthonormal at the points, which span the same space.
/// No polynomials are added, unless SubspaceOptions::linear says so: to kernels that decay, without energy. Fewer functions than
/// `centres` where the mesh has fewer points or they become dependent (noted).
///
/// Deterministic for a seed and any number of threads. Throws Error(invalid_argument): a mesh without extent;
/// cancelled, deadline_exceeded.
EnergySpace subspace_space(const Mesh& mesh, const SubspaceOptions& options, std::uint64_t seed, const RunContext& context = {});

/// Upper bound, before anything is allocated.
SpaceBytes estimate_subspace_space(const Mesh& mesh, const SubspaceOptions& options);

}  // namespace deform
