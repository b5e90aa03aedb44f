#pragma once

#include <string>

#include "core/mesh/region.h"
#include "deform/v1/setup.pb.h"

namespace deform::server {

/// Throws Error(invalid_argument) with the path of the field, see convert_setup.h.
Region region_from_proto(const v1::Region& message, const std::string& path);

/// Sorts id lists and drops repeated ids, everywhere in the tree.
void canonicalize_region(v1::Region& message);

}  // namespace deform::server
