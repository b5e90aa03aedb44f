#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/mesh/mesh.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// The ascending point ids of a handle of a setup that the server accepted.
std::vector<PointId> handle_points(const v1::Setup& setup, const std::string& handle, const Mesh& mesh);

/// A label per point: 0 for what may deform, 1 for what is fixed, 2 + i for handle i. Of regions that overlap the first handle
/// has the point.
std::vector<std::uint32_t> region_labels(const v1::Setup& setup, const Mesh& mesh);

}  // namespace deform::cli
