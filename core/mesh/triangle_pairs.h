// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "core/base/types.h"

namespace deform {

/// Coordinates of the corners of a triangle.
using TriangleCorners = std::array<Vec3, 3>;

/// Whether the triangle has no area: its corners are on one line. Exact.
bool has_no_area(const TriangleCorners& corners);

/// A triangle of a surface.
struct SurfaceTriangle {
  std::array<PointId, 3> places{};  ///< corners with the same number and the same coordinates are one
  TriangleCorners corners{};
};

/// Whether two triangles have more in common than the corners and sides that they share: whether they intersect or touch. With a
/// common corner: whether the side opposite to it of one meets the other. With a common side: whether they are in one plane and
/// on the same side of it. Both have an area. Exact, so that the answer depends neither on the order nor on the orientation of
/// the triangles. Any thread.
bool intersect(const SurfaceTriangle& a, const SurfaceTriangle& b);

}  // namespace deform
