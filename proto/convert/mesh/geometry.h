// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/mesh/mesh.h"
#include "deform/v1/geometry.pb.h"

namespace deform::convert {

/// The reply about a geometry, without the time of its registration and its setups.
v1::GeometryInfo geometry_info(const Mesh& mesh, const std::string& id, const std::string& name);

}  // namespace deform::convert
