// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "deform/v1/setup.pb.h"

namespace deform::client {

/// Puts the points and faces of the mesh file that method.cage names into its message; the file is looked for in `folder`.
/// Corners at the same place count as one point where a format has no others (STL). Without a file nothing is done. Throws
/// Error(invalid_argument, not_found) naming the field and the file: no such file, one that is no mesh, a face that is no
/// triangle, vertices or triangles beside the file.
void read_cage(const std::filesystem::path& folder, v1::Setup& setup);

}  // namespace deform::client
