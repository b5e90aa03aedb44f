// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/mesh/region.h"
#include "deform/v1/setup.pb.h"

namespace deform::convert {

/// Converts a region. Throws Error(invalid_argument) with the path of the field ("handles[2].region.box.min: expected 3 numbers,
/// got 2"): no or several kinds, wrong number of coordinates, non-finite numbers, nesting deeper than 64. Checks that need the
/// mesh are made by select().
Region region_from_proto(const v1::Region& message, const std::string& path);

/// Sorts id lists and drops repeated ids in the whole tree.
void canonicalize_region(v1::Region& message);

}  // namespace deform::convert
