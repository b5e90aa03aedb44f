#pragma once

#include <string>
#include <vector>

#include "core/mesh/mesh.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// The ascending point ids of a handle of a setup that the server accepted.
std::vector<PointId> handle_points(const v1::Setup& setup, const std::string& handle, const Mesh& mesh);

}  // namespace deform::cli
