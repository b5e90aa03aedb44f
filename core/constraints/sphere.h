// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// Projects points onto one sphere, by geometric distance. A given curvature (1 / radius) is kept. The limit of large spheres, a
/// plane, is included.
std::unique_ptr<const Projection> sphere_projection(std::size_t points, std::optional<double> curvature = {});

/// 1 / radius of the best-fitting sphere; 0 for a plane.
double sphere_curvature(std::span<const Vec3> x);

}  // namespace deform
