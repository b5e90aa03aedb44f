// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/mesh/mesh.h"

namespace deform::io {

/// The bytes of a new STL file (Reader::new_file): text with a solid for each group, or binary, which has no names, for a mesh
/// without groups. Throws Error(invalid_argument) for faces other than triangles.
std::string new_stl(const Mesh& mesh, const std::string& name);

}  // namespace deform::io
