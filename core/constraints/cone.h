// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// Projects points onto one nappe of a circular cone, by geometric distance; for points beyond the apex the apex is nearest. A
/// given half opening angle (radians) is kept. The limits, cylinder and plane, are included.
std::unique_ptr<const Projection> cone_projection(std::size_t points, std::optional<double> angle = {});

/// Half the opening angle of the best-fitting cone, radians; 0 for a cylinder.
double cone_angle(std::span<const Vec3> x);

}  // namespace deform
