// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/projection.h"

namespace deform {

/// Two points with bounds on their distance. `direction` (unit length) is used if they coincide.
struct PointPair {
  std::uint32_t a = 0, b = 0;
  double least = 0, most = std::numeric_limits<double>::infinity();
  Vec3 direction{1, 0, 0};  ///< from b to a
};

/// Projects each pair onto its bounds: both points move by the same length along their connecting line. A point may be in at most
/// one pair; points in no pair are free.
std::unique_ptr<const Projection> distance_projection(std::vector<PointPair> pairs, std::size_t points);

}  // namespace deform
