// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/mesh/mesh.h"

namespace deform::io {

/// The bytes of a new OBJ file: points, faces, and groups as g lines (Reader::new_file).
std::string new_obj(const Mesh& mesh, const std::string& name);

}  // namespace deform::io
