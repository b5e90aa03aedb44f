// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/base/types.h"
#include "core/mesh/elements.h"

namespace deform {

/// Whether the determinant of a good element is positive or, since its nodes stand in mirrored order, negative.
enum class Handedness { right, left };

/// The scaled Jacobian of ElementQuality of one element with these nodes; 0 where an edge has no length. Unchecked: every node is
/// one of the points. That of a left-handed element is that of its mirror image.
double scaled_jacobian(std::span<const Vec3> points, std::span<const PointId> nodes, ElementType type,
                       Handedness handedness = Handedness::right);

}  // namespace deform
