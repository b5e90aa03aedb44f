// SPDX-License-Identifier: Apache-2.0
#include "core/measures/measure.h"

#include <string>

#include "core/base/checks.h"
#include "core/base/error.h"

namespace deform::measures {

Measurement Measure::evaluate(std::span<const Vec3> points, Gradients gradients, const RunContext& context) const {
  if (points.size() != point_count_) {
    throw Error(ErrorCode::invalid_argument,
                "points: " + std::to_string(points.size()) + ", the mesh has " + std::to_string(point_count_));
  }
  check_finite(points, "points");
  return measured(points, gradients, context);
}

}  // namespace deform::measures
