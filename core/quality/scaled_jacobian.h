// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/base/types.h"
#include "core/mesh/elements.h"

namespace deform {

/// Whether the determinant of a valid element is positive (right) or, with its nodes in mirrored order, negative (left).
enum class Handedness { right, left };

/// The scaled Jacobian, as in ElementQuality, of one element with these nodes; 0 if an edge has zero length. A left-handed
/// element has that of its mirror image. Node ids must be in range; they are not checked.
double scaled_jacobian(std::span<const Vec3> points, std::span<const PointId> nodes, ElementType type,
                       Handedness handedness = Handedness::right);

}  // namespace deform
