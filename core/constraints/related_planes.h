// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <vector>

#include "core/constraints/projection.h"

namespace deform {

/// Projects each region onto a plane of its own, with all planes parallel: the common normal is the axis of least moment of the
/// regions about their own means (closed form). `points` holds the number of points of each region.
std::unique_ptr<const Projection> parallel_projection(const std::vector<std::size_t>& points);

/// Projects two regions onto one plane each, with the planes perpendicular.
std::unique_ptr<const Projection> orthogonal_projection(const std::vector<std::size_t>& points);

}  // namespace deform
