// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>

#include "core/constraints/projection.h"

namespace deform {

/// All points in one plane: the one across the axis of least moment (total least squares; closed form). Never needs a start.
std::unique_ptr<const Projection> plane_projection(std::size_t points);

/// All points on one straight line, the axis of greatest moment.
std::unique_ptr<const Projection> line_projection(std::size_t points);

/// The points slide in the plane through `point` at right angles to `normal` (unit length).
std::unique_ptr<const Projection> fixed_plane_projection(const Vec3& point, const Vec3& normal, std::size_t points);

}  // namespace deform
