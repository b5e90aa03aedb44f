#pragma once

#include <vector>

#include "core/constraints/detection/detect.h"
#include "deform/v1/detection.pb.h"

namespace deform::server {

/// Throws Error(invalid_argument) with the path of the field.
DetectOptions detect_options(const v1::DetectRequest& request);

/// What detecting on a mesh takes at most beside the mesh, bytes.
std::size_t detect_bytes(const Mesh& mesh);

/// In the order of detection.proto, without `seconds`.
std::vector<v1::DetectReply> detect_replies(const Detection& detection);

}  // namespace deform::server
