// SPDX-License-Identifier: Apache-2.0
#include "core/quality/displacement.h"

#include <cmath>
#include <cstdio>
#include <limits>

#include "core/base/vectors.h"

namespace deform {

namespace {

std::string rounded(const char* format, double value) {
  char text[40];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

}  // namespace

// Squares are compared, so that the root is taken once.
Extreme largest_displacement(std::span<const Vec3> points, std::span<const Vec3> original) {
  double largest = 0;
  std::size_t at = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double square = squared_distance(points[i], original[i]);
    if (std::isnan(square)) return {std::numeric_limits<double>::infinity(), i};
    if (square > largest) {
      largest = square;
      at = i;
    }
  }
  if (points.empty()) return {};
  return {distance(points[at], original[at]), at};
}

std::optional<std::string> displacement_warning(const Extreme& largest, double prescribed, double diagonal) {
  if (!(prescribed > 0) || !(largest.value > 1e-9 * diagonal)) return std::nullopt;
  const double ratio = largest.value / prescribed;
  if (!(ratio >= displacement_ratio_to_warn)) return std::nullopt;
  return "point " + std::to_string(largest.id) + " moves " + rounded("%.3g", largest.value) + ", " +
         rounded(ratio < 1000 ? "%.1f" : "%.0e", ratio) + " times the largest prescribed displacement (" +
         rounded("%.3g", prescribed) +
         "): the surface may be folded or stretched there; move more of what is around the handles, " + "or move them less";
}

}  // namespace deform
