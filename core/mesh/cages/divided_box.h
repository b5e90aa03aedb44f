// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <optional>

#include "core/base/types.h"
#include "core/mesh/mesh.h"

namespace deform {

/// How the faces of a box are divided into rectangles of two triangles each.
struct BoxDivisions {
  std::array<std::size_t, 3> counts{};  ///< rectangles along each axis, 1 or more
  /// In the plane across which axes, through its middle, the box is its own mirror image, triangle by triangle. The number of
  /// rectangles along such an axis is even, as no diagonal of one in the middle is its own image.
  std::array<bool, 3> mirrored{};
};

/// The divisions of a box whose rectangles are the squarest, if there are any.
struct SquarestDivisions {
  std::optional<BoxDivisions> divisions;
  double flatness = std::numeric_limits<double>::infinity();  ///< longest over shortest side of its rectangles
  /// The nearest numbers of points that there are; 0: none.
  std::size_t below = 0, above = 0;
};
/// The squarest of all divisions with so many points, to CageRequest::count_tolerance, and angles of 15 degrees or more. `sides`:
/// of the box, model units, over 0.
SquarestDivisions squarest_divisions(const Vec3& sides, std::size_t points, const std::array<bool, 3>& mirrored);

/// A closed triangle mesh that faces outwards. Diagonals are all the same way, but on the other side of planes in which the box
/// is its own mirror image.
Mesh divided_box(const Box& box, const BoxDivisions& divisions);

}  // namespace deform
