// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <string>

#include "core/base/types.h"
#include "core/base/vectors.h"
#include "core/quality/extreme.h"

namespace deform {

/// The largest of `count` displacements from `original`, of that many points, to `place(i)`, and its index, the first of several.
/// The value is 0 without points, and infinite if a place is not finite. Squares are compared, so that the root is taken once,
/// and lengths where squares overflow.
template <typename Place>
Extreme largest_distance(std::size_t count, const Place& place, std::span<const Vec3> original) {
  constexpr double infinite = std::numeric_limits<double>::infinity();
  double largest = 0;
  std::size_t at = 0;
  for (std::size_t i = 0; i < count && largest < infinite; ++i) {
    const double square = squared_distance(place(i), original[i]);
    if (std::isnan(square)) return {infinite, i};
    if (square > largest) {
      largest = square;
      at = i;
    }
  }
  if (count == 0) return {};
  if (largest < infinite) return {distance(place(at), original[at]), at};
  largest = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 to = place(i);
    const double length = distance(to, original[i]);
    if (!is_finite(to) || !std::isfinite(length)) return {infinite, i};  // std::hypot() of libstdc++ may lose a NaN
    if (length > largest) {
      largest = length;
      at = i;
    }
  }
  return {largest, at};
}

/// The largest displacement of a point and the id of that point, the first of several. Both spans have the same size. The value
/// is 0 without points, and infinite if a point is not finite.
Extreme largest_displacement(std::span<const Vec3> points, std::span<const Vec3> original);

/// Why a displacement is too large for the coordinates of a model with this diagonal, in one sentence: from 1e12 times the
/// diagonal on they are rounded by more than 1e-4 of it. No text below, and for a diagonal of 0.
std::optional<std::string> beyond_digits(double displacement, double diagonal);

/// The ratio to the largest prescribed displacement from which on displacement_warning() warns.
inline constexpr double displacement_ratio_to_warn = 1.5;

/// A warning in one sentence if `largest` exceeds `prescribed`, the largest prescribed displacement, by this ratio or more, with
/// the cause and what to do where that is known. No warning if nothing is prescribed or if the displacement is below 1e-9 of the
/// diagonal.
std::optional<std::string> displacement_warning(const Extreme& largest, double prescribed, double diagonal,
                                                const std::string& cause = {});

/// The same of points that are not the mesh's, of which `place` moves most: in one sentence, with how far it lies outside of the
/// box of the mesh, where methods extrapolate.
std::optional<std::string> displacement_warning_elsewhere(const Extreme& largest, const Vec3& place, double prescribed,
                                                          const Box& mesh);

}  // namespace deform
