// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// All points on one nappe of a round cone, by geometric distance; beyond the apex the apex is the nearest point. A given angle
/// (half the opening, radians) is kept. The limits, cylinder and plane, are included.
std::unique_ptr<const Projection> cone_projection(std::size_t points, std::optional<double> angle = {});

/// Half the opening angle of the cone that fits best, radians; 0 for a cylinder.
double cone_angle(std::span<const Vec3> x);

}  // namespace deform
