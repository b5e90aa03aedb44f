// SPDX-License-Identifier: Apache-2.0
#include "core/quality/displacement.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/base/vectors.h"

namespace deform {

namespace {

std::string rounded(const char* format, double value) {
  char text[40];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

/// "point 3 moves 0.5, 2.0 times the largest prescribed displacement (0.25)", if that is to be warned of.
std::optional<std::string> excess_text(const Extreme& largest, double prescribed, double diagonal) {
  if (!(prescribed > 0) || !(largest.value > 1e-9 * diagonal)) return std::nullopt;
  const double ratio = largest.value / prescribed;
  if (!(ratio >= displacement_ratio_to_warn)) return std::nullopt;
  return "point " + std::to_string(largest.id) + " moves " + rounded("%.3g", largest.value) + ", " +
         rounded(ratio < 1000 ? "%.1f" : "%.0e", ratio) + " times the largest prescribed displacement (" +
         rounded("%.3g", prescribed) + ")";
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
  const auto excess = excess_text(largest, prescribed, diagonal);
  if (!excess) return std::nullopt;
  return *excess + ": the surface may be folded or stretched there; " +
         (cause.empty() ? std::string("move more of what is around the handles, or move them less") : cause);
}

std::optional<std::string> displacement_warning_elsewhere(const Extreme& largest, const Vec3& place, double prescribed,
                                                          const Box& mesh) {
  const auto excess = excess_text(largest, prescribed, mesh.diagonal());
  if (!excess) return std::nullopt;
  Vec3 beyond{};
  for (int k = 0; k < 3; ++k) beyond[k] = std::max({0.0, mesh.min[k] - place[k], place[k] - mesh.max[k]});
  const double outside = norm(beyond);
  if (outside == 0) return *excess + ": space may be folded or stretched there";
  return *excess + ": it lies " + rounded("%.3g", outside) + " (" + rounded("%.2g", outside / mesh.diagonal()) +
         " D) outside of the box of the mesh, where the method extrapolates; fixed points around what is evaluated keep it in "
         "place";
}

}  // namespace deform
