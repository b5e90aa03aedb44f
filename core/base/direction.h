// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "core/base/vectors.h"

namespace deform {

/// Why a vector of any length gives no direction, as the end of a sentence about it; null if it gives one.
inline const char* direction_problem(const Vec3& v) {
  if (!is_finite(v)) return "must be finite";
  if (v[0] == 0 && v[1] == 0 && v[2] == 0) return "must not be zero";
  const double size = norm(v);
  if (std::isnormal(size)) return nullptr;
  return size < 1 ? "is too short: its length must be at least 1e-307" : "is too long: its length must be less than 1e308";
}

}  // namespace deform
