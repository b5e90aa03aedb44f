// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/coordinate_limits.h"

#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/base/number_text.h"

namespace deform {

void check_coordinates(std::span<const Vec3> points, const std::string& field) {
  const Box box = bounding_box(points);
  const auto beyond = [](double x) { return std::abs(x) > most_coordinate; };
  double extent = 0;
  bool far = false;
  for (int k = 0; k < 3 && !points.empty(); ++k) {
    far = far || beyond(box.min[k]) || beyond(box.max[k]);
    extent = std::max(extent, box.side(k));
  }
  for (std::size_t i = 0; far && i < points.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      if (!beyond(points[i][k])) continue;
      throw Error(ErrorCode::invalid_argument, field + "[" + std::to_string(i) + "]: coordinate " + std::string(1, "xyz"[k]) +
                                                   " is " + number_digits(points[i][k]) + ", the limit is " +
                                                   number_digits(most_coordinate) +
                                                   ": powers of lengths have to be finite; use another unit of length");
    }
  }
  if (extent == 0 || extent >= least_extent) return;
  throw Error(ErrorCode::invalid_argument, field + ": their bounding box is " + number_digits(extent) + " long, the least is " +
                                               number_digits(least_extent) +
                                               ": powers of lengths would vanish; use another unit of length");
}

}  // namespace deform
