// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// All points on one round cylinder of any length, by geometric distance (Schneider and Eberly 2002, which the thesis names,
/// minimize squared differences of squared radii instead; a search like theirs gives the start here). A given curvature (1 /
/// radius) is kept. The limit of very large cylinders, a plane, is included.
std::unique_ptr<const Projection> cylinder_projection(std::size_t points, std::optional<double> curvature = {});

/// 1 / radius of the cylinder that fits best; 0 for a plane.
double cylinder_curvature(std::span<const Vec3> x);

}  // namespace deform
