// SPDX-License-Identifier: Apache-2.0
#include "core/base/bounds.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace deform {

namespace {

/// The tolerance at a bound: one step of float beyond its rounded value, or 1e-6 of the range.
double slack(double bound, double range) {
  constexpr double share = 1e-6;
  const auto rounded = static_cast<float>(std::abs(bound));
  const auto next = static_cast<double>(std::nextafter(rounded, std::numeric_limits<float>::infinity()));
  return std::max(next - std::abs(bound), std::isfinite(range) ? share * range : 0.0);
}

}  // namespace

std::optional<double> within_bounds(double value, double lower, double upper) {
  if (value >= lower && value <= upper) return value;
  const double range = upper - lower;
  if (value < lower && std::isfinite(lower) && lower - value <= slack(lower, range)) return lower;
  if (value > upper && std::isfinite(upper) && value - upper <= slack(upper, range)) return upper;
  return std::nullopt;
}

}  // namespace deform
