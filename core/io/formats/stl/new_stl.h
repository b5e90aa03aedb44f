// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/mesh/mesh.h"

namespace deform::io {

/// A new STL file: text with a solid for each group, or binary, which has no names, of a mesh without groups. Reader::new_file;
/// throws Error(invalid_argument) for faces other than triangles.
std::string new_stl(const Mesh& mesh, const std::string& name);

}  // namespace deform::io
