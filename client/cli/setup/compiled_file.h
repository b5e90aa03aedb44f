// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <string>

#include "core/compiled/content.h"
#include "core/mesh/mesh.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// Whether a file begins like a compiled deformation; false where there is none.
bool is_compiled_file(const std::filesystem::path& file);

/// The setup that was compiled. Throws Error(data_loss) where the file has none that can be read.
v1::Setup compiled_setup(const compiled::Content& content, const std::filesystem::path& file);

/// The mesh file that results are written into: `source`, or the one that was compiled, by its name, in the folder of the
/// compiled deformation or this one. Throws Error(invalid_argument) where neither is there.
std::filesystem::path compiled_mesh_path(const compiled::Content& content, const std::filesystem::path& file,
                                         const std::string& source);

/// Throws Error(invalid_argument) when the mesh, read from `path`, is not the one that was compiled.
void check_compiled_mesh(const compiled::Content& content, const Mesh& mesh, const std::filesystem::path& path);

}  // namespace deform::cli
