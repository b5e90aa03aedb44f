// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <string>

#include "core/base/types.h"
#include "core/quality/extreme.h"

namespace deform {

/// How far the point that moves farthest is from where it was, and which it is: the first of several. Both spans have as many
/// points; 0 without any, infinite where a point is not finite.
Extreme largest_displacement(std::span<const Vec3> points, std::span<const Vec3> original);

/// Points that move so much farther than the largest prescribed displacement are worth a warning.
inline constexpr double displacement_ratio_to_warn = 1.5;

/// The warning in one sentence: when `largest` exceeds `prescribed`, the largest prescribed displacement, by
/// that ratio or more. None where nothing is prescribed, nor for what is below 1e-9 of the diagonal.
std::optional<std::string> displacement_warning(const Extreme& largest, double prescribed, double diagonal);

}  // namespace deform
