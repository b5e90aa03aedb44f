// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/base/run_context.h"
#include "core/deformers/energy/spaces/energy_space.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// Moving least squares deformation in space (thesis 8.4): k samples spread over surface and volume, N = cubature * k integration
/// points spread in the same way, energies gamma_s |grad d|^2 + gamma_b |hessian d|^2 at them with their Voronoi volumes, or on a
/// mesh without cells their Voronoi areas. All in unit coordinates (divided by the bounding-box diagonal).
///
/// Two decisions, because the thesis leaves them open:
///  - Bending is the whole second derivative. It agrees with |laplace d|^2 (eq. 8.13) where the rim of the domain is held; but
///  that costs
///    nothing for harmonic functions, so with a free rim, or one where only positions are held, its least is the harmonic one,
///    which bends sharply at the handles. Here only affine displacements cost nothing.
///  - With MlsDomain::enclosed a mesh without cells is what its faces enclose (EnclosedPieces), a body like that of cells, in
///  which affine motions are exact. Where they do not, and with MlsDomain::surface, it is its surface: integration points lie on
///  it and derivatives count along it. Where the samples around a point
///    are flat to a tenth (variance across below 1e-2), derivatives across are left out, because samples do not tell them there:
///    the least curvature would make them up; so curved parts do not turn exactly. Elsewhere (edges, thin walls) it is a body in
///    space like any other. With volume_samples > 0 the box around the surface is the body.
///
/// Parts of the mesh that no support joins (components that are far apart) are tied to the others weakly: they follow the
/// continuation of their motion, as far as nothing else holds them.
///
/// Deterministic for a seed and any number of threads. Throws Error(invalid_argument): a mesh without extent;
/// cancelled, deadline_exceeded.
EnergySpace mls_space(const Mesh& mesh, const MlsOptions& options, std::uint64_t seed, const RunContext& context = {});

/// Upper bound of what mls_space() needs at its peak, and of what the space holds: cheap, before anything is allocated.
struct SpaceBytes {
  std::size_t peak = 0, resident = 0;
  std::size_t samples = 0, cubature_points = 0;
  std::size_t cover = 0;           ///< functions that reach a point
  std::size_t energy_entries = 0;  ///< of the lower triangle
};
SpaceBytes estimate_mls_space(const Mesh& mesh, const MlsOptions& options);

}  // namespace deform
