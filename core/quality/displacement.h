// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <string>

#include "core/base/types.h"
#include "core/quality/extreme.h"

namespace deform {

/// The largest displacement of a point and the id of that point, the first of several. Both spans have the same size. The value
/// is 0 without points, and infinite if a point is not finite.
Extreme largest_displacement(std::span<const Vec3> points, std::span<const Vec3> original);

/// The ratio to the largest prescribed displacement from which on displacement_warning() warns.
inline constexpr double displacement_ratio_to_warn = 1.5;

/// A warning in one sentence if `largest` exceeds `prescribed`, the largest prescribed displacement, by this ratio or more. No
/// warning if nothing is prescribed or if the displacement is below 1e-9 of the diagonal.
std::optional<std::string> displacement_warning(const Extreme& largest, double prescribed, double diagonal);

}  // namespace deform
