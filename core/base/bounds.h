// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

namespace deform {

/// `value` where lower <= value <= upper. What is outside by at most 1e-6 of the range, or by one step of single precision from
/// the bound, is that bound exactly: optimizers that compute in float32 end beside their bounds. Nothing for anything else, NaN
/// too. Bounds may be infinite.
std::optional<double> within_bounds(double value, double lower, double upper);

}  // namespace deform
