// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// Projects points onto one infinite circular cylinder, by geometric distance. (Schneider and Eberly 2002, cited by the thesis,
/// minimize squared differences of squared radii; a similar search gives the start here.) A given curvature (1 / radius) is kept.
/// The limit of large cylinders, a plane, is included.
std::unique_ptr<const Projection> cylinder_projection(std::size_t points, std::optional<double> curvature = {});

/// 1 / radius of the best-fitting cylinder; 0 for a plane.
double cylinder_curvature(std::span<const Vec3> x);

}  // namespace deform
