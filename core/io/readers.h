#pragma once

#include <memory>
#include <string>

#include "core/io/mesh_file.h"

namespace deform::io {

// One reader per format. `bytes` are unpacked already; `name` stands in errors. Errors as parse_mesh().

std::unique_ptr<MeshFile> parse_obj(std::string bytes, const std::string& name);
std::unique_ptr<MeshFile> parse_off(std::string bytes, const std::string& name);
std::unique_ptr<MeshFile> parse_ply(std::string bytes, const std::string& name);
std::unique_ptr<MeshFile> parse_stl(std::string bytes, const std::string& name);

}  // namespace deform::io
