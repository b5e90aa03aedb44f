// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/base/types.h"
#include "core/mesh/elements.h"

namespace deform {

/// The scaled Jacobian of ElementQuality of one element with these nodes; 0 where an edge has no length. Unchecked: every node is
/// one of the points.
double scaled_jacobian(std::span<const Vec3> points, std::span<const PointId> nodes, ElementType type);

}  // namespace deform
