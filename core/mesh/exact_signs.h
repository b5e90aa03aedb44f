// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/base/types.h"

namespace deform {

// Signs of determinants: exact unless products of three differences of coordinates overflow or underflow. The determinant is
// first evaluated with a bound of its rounding; where that does not tell the sign, as a sum of exact products (J. R. Shewchuk,
// Adaptive precision floating-point arithmetic and fast robust geometric predicates, 1997). Any thread.

/// The side of the plane through a, b and c on which d lies: 1 if it sees them clockwise, -1 if counter-clockwise, 0 in the
/// plane.
int side_of_plane(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d);
/// The same, or 0 where rounding leaves it open.
int clear_side_of_plane(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d);

/// The side of the line from a to b on which c lies, without the coordinate `axis`: 1 on the left of it where the axis points to
/// the viewer, -1 on the right, 0 on it.
int side_of_line(const Vec3& a, const Vec3& b, const Vec3& c, int axis);
/// The same, or 0 where rounding leaves it open.
int clear_side_of_line(const Vec3& a, const Vec3& b, const Vec3& c, int axis);

}  // namespace deform
