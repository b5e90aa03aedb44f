// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/base/run_context.h"
#include "core/deformers/energy/spaces/energy_space.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// Moving least squares deformation in space (thesis 8.4): k samples distributed over surface and volume, and N = cubature * k
/// integration points distributed in the same way. The energies gamma_s |grad d|^2 + gamma_b |hessian d|^2 are weighted with the
/// Voronoi volumes of the integration points or, for a mesh without cells, with their Voronoi areas. All quantities are in unit
/// coordinates (divided by the bounding-box diagonal).
///
/// Two choices that the thesis leaves open:
///  - The bending energy uses the full second derivative. It agrees with |laplace d|^2 (eq. 8.13) if the boundary of the domain
///    is clamped; but the Laplacian vanishes for harmonic functions, so with a free boundary, or one where only positions are
///    prescribed, the minimizer is harmonic and bends sharply at the handles. Here only affine displacements have zero energy.
///  - Unless MlsDomain::surface is chosen, a mesh without cells is the volume enclosed by its faces (EnclosedPieces), a body like
///    one with cells, for which affine motions are exact. If the faces do not enclose a volume, and with MlsDomain::surface, it
///    is the surface: integration points lie on it and tangential derivatives count. Where the samples around a point are
///    nearly coplanar (normal variance below 1e-2), normal derivatives are left out, because the samples do not determine them
///    and the least curvature would be arbitrary; so curved parts do not rotate exactly. Elsewhere (edges, thin walls) the
///    surface is a body in space. With volume_samples > 0 the body is the box around the surface.
///
/// With MlsDomain::connected and body, distances from samples are those within the enclosed body (BodyReach): a slot narrower
/// than a support does not join its sides. Across gaps between separate bodies straight distances count, as with
/// MlsDomain::enclosed.
///
/// Parts of the mesh that no support connects (components far apart) are weakly coupled to the others: they follow the
/// extrapolated motion, as far as they are free.
///
/// The result depends on the seed only, not on the number of threads. Throws Error(invalid_argument) for a mesh without extent,
/// cancelled, deadline_exceeded.
EnergySpace mls_space(const Mesh& mesh, const MlsOptions& options, std::uint64_t seed, const RunContext& context = {});

/// Upper bounds of the peak memory of mls_space() and of the memory of the space: cheap, before anything is allocated.
struct SpaceBytes {
  std::size_t peak = 0, resident = 0;
  std::size_t samples = 0, cubature_points = 0;
  std::size_t cover = 0;           ///< functions that are nonzero at a point
  std::size_t energy_entries = 0;  ///< entries of the lower triangle of the energy
  double seconds = 0;              ///< rough time of mls_space() with all cores; 0: not known
};
SpaceBytes estimate_mls_space(const Mesh& mesh, const MlsOptions& options);

/// How many functions are nonzero at some of these points (model units), at most: as many as there are samples on the part of a
/// surface, or in the cells, that supports reach from the points; with an enclosed volume or a box all of them.
std::size_t estimate_mls_reach(const Mesh& mesh, const MlsOptions& options, std::span<const Vec3> places);

}  // namespace deform
