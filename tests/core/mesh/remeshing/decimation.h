// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>

#include "core/mesh/surface_mesh/surface_mesh.h"

namespace deform {

/// A closed triangle mesh with fewer vertices: half-edge collapses in the order of their error quadrics (thesis 3.4.1, M.
/// Garland, P. S. Heckbert, Surface simplification using quadric error metrics, 1997), weighted by area. The vertices that remain
/// keep their places; the topology stays, no triangle turns over. Fewer collapses may be possible than asked for: ask the result
/// for its vertex_count(). Deterministic. O(n log n).
///
/// Throws Error(invalid_argument): fewer than 4 vertices asked for, and as check_closed_triangles().
SurfaceMesh decimated(const SurfaceMesh& mesh, std::size_t vertices);

}  // namespace deform
