// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh/mesh.h"

namespace deform {

inline constexpr std::uint32_t no_corner = 0xFFFFFFFF;

/// The edges of a 2-manifold. Corner c of the mesh stands for the edge from its point to the next corner of its face; entry c is
/// the corner of the same edge in the other face, or no_corner on the boundary. O(corners), by counting sort.
///
/// Throws Error(invalid_argument) naming the faces, and the edge by its points: a face of fewer than three corners or that
/// repeats one, an edge with more than two faces, or that two faces run along in the same direction; 2^32 - 2 corners or more.
std::vector<std::uint32_t> paired_corners(const Mesh& mesh);

}  // namespace deform
