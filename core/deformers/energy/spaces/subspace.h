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

/// The energy of the shell in a subspace of few functions in space (thesis 8.3, eq. 8.11): K = Phi^T E Phi with E = -gamma_s L +
/// gamma_b L M^-1 L from shell_operators(), all in unit coordinates. Centres are distributed over the faces (8.3, figure 8.2).
///  - without a kernel: linear moving least squares (8.3.3), which reproduce affine motions.
///  - kernels that decay: cut off at the radius that the cover requires (8.3.2), see KernelProperties::local_shape.
///  - kernels without a shape, such as r^3 and r (8.3.1): dense matrices, and the functions are numerically linearly dependent
///    (the thesis reports that they "fail" for stretching, as the Cholesky factorization of Phi^T E Phi breaks down). So they are
///    replaced by combinations that are orthonormal at the points and span the same space.
/// Polynomials, without energy, are added only to kernels that decay and only if SubspaceOptions::linear requests it. There are
/// fewer functions than `centres` if the mesh has fewer points or the functions become dependent (with a note).
///
/// The result depends on the seed only, not on the number of threads. Throws Error(invalid_argument) for a mesh without extent,
/// cancelled, deadline_exceeded.
EnergySpace shell_subspace(const Mesh& mesh, const SubspaceOptions& options, std::uint64_t seed, const RunContext& context = {});

/// Upper bounds for shell_subspace(), before anything is allocated.
SpaceBytes estimate_shell_subspace(const Mesh& mesh, const SubspaceOptions& options);

}  // namespace deform
