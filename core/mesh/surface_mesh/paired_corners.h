// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh/mesh.h"

namespace deform {

inline constexpr std::uint32_t no_corner = 0xFFFFFFFF;

/// Matches the edges of a 2-manifold. Corner c of the mesh stands for the edge from its point to the next corner of its face;
/// entry c is the corner of the same edge in the adjacent face, or no_corner on the boundary. O(corners), by counting sort.
///
/// Throws Error(invalid_argument) naming the faces, and the edge by its points: a face with fewer than three corners or a
/// repeated one, an edge with more than two faces or with two faces that traverse it in the same direction. Also throws for 2^32
/// - 2 corners or more.
std::vector<std::uint32_t> paired_corners(const Mesh& mesh);

}  // namespace deform
