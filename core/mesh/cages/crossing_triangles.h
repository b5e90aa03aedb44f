// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "core/mesh/mesh.h"

namespace deform {

/// How many pairs of triangles of a triangle mesh cross each other: an edge of one passes through the other, in doubles. Pairs
/// that share an edge are not looked at, nor are triangles that only touch. Throws Error(invalid_argument) for a face that is no
/// triangle.
std::size_t crossing_triangles(const Mesh& mesh);

}  // namespace deform
