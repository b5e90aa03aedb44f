#pragma once

#include <cstdint>
#include <string>

#include "core/mesh/mesh.h"
#include "deform/v1/geometry.pb.h"
#include "server/store/catalog.h"

namespace deform::server {

/// What a client is told about a geometry, but for the time of its registration and its setups.
v1::GeometryInfo describe(const Mesh& mesh, const std::string& id, const std::string& name);

/// The record of a geometry that is registered now, or was at that time (milliseconds since 1970).
GeometryRecord geometry_record(v1::GeometryInfo info, std::int64_t registered_ms);

}  // namespace deform::server
