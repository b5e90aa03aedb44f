// SPDX-License-Identifier: Apache-2.0
#include "core/quality/displacement.h"

#include <cmath>
#include <cstdio>

namespace deform {

namespace {

std::string rounded(const char* format, double value) {
  char text[40];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

}  // namespace

Extreme largest_displacement(std::span<const Vec3> points, std::span<const Vec3> original) {
  return largest_distance(
      points.size(), [&](std::size_t i) { return points[i]; }, original);
}

std::optional<std::string> beyond_digits(double displacement, double diagonal) {
  constexpr double most = 1e12;
  if (!(diagonal > 0) || !(displacement / diagonal > most)) return std::nullopt;
  return "points move by up to " + rounded("%.3g", displacement / diagonal) +
         " times the diagonal of the model, where the rounding of coordinates destroys its shape; are the variables in its "
         "units?";
}

std::optional<std::string> displacement_warning(const Extreme& largest, double prescribed, double diagonal,
                                                const std::string& cause) {
  if (!(prescribed > 0) || !(largest.value > 1e-9 * diagonal)) return std::nullopt;
  const double ratio = largest.value / prescribed;
  if (!(ratio >= displacement_ratio_to_warn)) return std::nullopt;
  return "point " + std::to_string(largest.id) + " moves " + rounded("%.3g", largest.value) + ", " +
         rounded(ratio < 1000 ? "%.1f" : "%.0e", ratio) + " times the largest prescribed displacement (" +
         rounded("%.3g", prescribed) + "): the surface may be folded or stretched there; " +
         (cause.empty() ? std::string("move more of what is around the handles, or move them less") : cause);
}

}  // namespace deform
