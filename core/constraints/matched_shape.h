// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <span>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

enum class Match { rigid, similar };  ///< without and with uniform scaling; never mirrored

/// The shape `rest`, moved, turned and with Match::similar scaled as the points are best met: Kabsch (1976), Umeyama (1991).
/// Closed form; never needs a start.
std::unique_ptr<const Projection> matched_projection(std::span<const Vec3> rest, Match match);

}  // namespace deform
