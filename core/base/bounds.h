// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

namespace deform {

/// Returns `value` if lower <= value <= upper. A value outside by at most 1e-6 of the range, or by one single-precision step from
/// the bound, is clamped to that bound, because optimizers that compute in float32 overshoot their bounds slightly. Returns
/// std::nullopt for any other value, including NaN. Bounds may be infinite.
std::optional<double> within_bounds(double value, double lower, double upper);

}  // namespace deform
