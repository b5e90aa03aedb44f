// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>

#include "core/mesh/mesh.h"

namespace deform::bench {

/// A triangle mesh with edges cut at their middles until it has `points` points: all edges as long as all fit, then the longest.
/// What was there keeps its ids; groups hold the parts of their faces. Throws Error(invalid_argument) for faces that are no
/// triangles.
Mesh refined(Mesh mesh, std::size_t points);

}  // namespace deform::bench
