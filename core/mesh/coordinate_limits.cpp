// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/coordinate_limits.h"

#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/base/number_text.h"

namespace deform {

void check_magnitudes(std::span<const Vec3> points, const std::string& field, std::uint64_t first) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      if (!(std::abs(points[i][k]) > most_coordinate)) continue;
      throw Error(ErrorCode::invalid_argument, field + "[" + std::to_string(first + i) + "]: coordinate " +
                                                   std::string(1, "xyz"[k]) + " is " + number_digits(points[i][k]) +
                                                   ", the limit is " + number_digits(most_coordinate) +
                                                   ": powers of lengths have to be finite; use another unit of length");
    }
  }
}

void check_coordinates(std::span<const Vec3> points, const std::string& field) {
  check_magnitudes(points, field);
  const Box box = bounding_box(points);
  double extent = 0;
  for (int k = 0; k < 3 && !points.empty(); ++k) extent = std::max(extent, box.side(k));
  if (extent == 0 || extent >= least_extent) return;
  throw Error(ErrorCode::invalid_argument, field + ": their bounding box is " + number_digits(extent) + " long, the least is " +
                                               number_digits(least_extent) +
                                               ": powers of lengths would vanish; use another unit of length");
}

}  // namespace deform
