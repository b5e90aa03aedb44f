// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// Projects points onto one circle. Plane and circle are fitted together by the distance in space: fitting the plane first and
/// then a circle in it does not give the nearest configuration, and the energy of the alternation can rise. A given curvature (1
/// / radius) is kept. The limit of large circles, a straight line, is included.
std::unique_ptr<const Projection> circle_projection(std::size_t points, std::optional<double> curvature = {});

/// 1 / radius of the best-fitting circle; 0 for a line.
double circle_curvature(std::span<const Vec3> x);

}  // namespace deform
