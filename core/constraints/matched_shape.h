// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <span>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

enum class Match { rigid, similar };  ///< without and with uniform scaling; never mirrored

/// Projects points onto the best-fitting translated, rotated and, for Match::similar, scaled copy of `rest` (Kabsch 1976, Umeyama
/// 1991). Closed form; needs no start.
std::unique_ptr<const Projection> matched_projection(std::span<const Vec3> rest, Match match);

}  // namespace deform
