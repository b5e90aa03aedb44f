// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/mesh/mesh.h"

namespace deform {

/// The convex hull of points as a closed triangle mesh that faces outwards, by quickhull (C. B. Barber, D. P. Dobkin, H.
/// Huhdanpaa, The quickhull algorithm for convex hulls, 1996).
///
/// Points are rounded to a grid of 2^-20 of the longest side of their box, on which the predicates are exact integers: the result
/// is the exact hull of the rounded points, convex whatever the input, in any units, and off from the hull of the points by at
/// most one step of the grid. Points in a plane, on a line or at one place get a hull that is two steps thick. Deterministic.
///
/// Throws Error(invalid_argument): no point, one that is not finite.
Mesh convex_hull(std::span<const Vec3> points);

}  // namespace deform
