// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>

#include "core/constraints/projection.h"

namespace deform {

/// Projects points onto one plane, perpendicular to the axis of least moment (total least squares; closed form). Needs no start.
std::unique_ptr<const Projection> plane_projection(std::size_t points);

/// Projects points onto one straight line, the axis of greatest moment.
std::unique_ptr<const Projection> line_projection(std::size_t points);

/// Projects points onto the given plane through `point` with unit normal `normal`, in which they may slide.
std::unique_ptr<const Projection> fixed_plane_projection(const Vec3& point, const Vec3& normal, std::size_t points);

}  // namespace deform
