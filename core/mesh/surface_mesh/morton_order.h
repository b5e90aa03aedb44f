// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Sorts `ids` of points along the Morton (z-order) curve through their bounding box, 21 bits for each coordinate; points in the
/// same cell are sorted by id. G. M. Morton, A computer oriented geodetic data base and a new technique in file sequencing, 1966.
void sort_along_morton_curve(std::span<const Vec3> points, std::vector<std::uint32_t>& ids);

}  // namespace deform
