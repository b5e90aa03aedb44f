// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <vector>

#include "core/constraints/projection.h"

namespace deform {

/// Each region in a plane of its own, all parallel: the common normal is the axis of least moment of the regions about their own
/// means (closed form). `points`: per region, one after the other.
std::unique_ptr<const Projection> parallel_projection(const std::vector<std::size_t>& points);

/// Two regions, each in a plane, at right angles to each other.
std::unique_ptr<const Projection> orthogonal_projection(const std::vector<std::size_t>& points);

}  // namespace deform
