// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// Two points whose distance stays between the bounds; `direction` (unit length) is used where they coincide.
struct PointPair {
  std::uint32_t a = 0, b = 0;
  double least = 0, most = std::numeric_limits<double>::infinity();
  Vec3 direction{1, 0, 0};  ///< from b to a
};

/// Every pair moves apart or together along the line through it, both points by the same length. Points in no pair are free; no
/// point may be in two.
std::unique_ptr<const Projection> distance_projection(std::vector<PointPair> pairs, std::size_t points);

}  // namespace deform
