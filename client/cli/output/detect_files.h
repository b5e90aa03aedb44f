// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <string>

#include "client/client.h"
#include "core/mesh/mesh.h"

namespace deform::cli {

/// The faces in one colour per primitive, grey where there is none: .ply, or .vtp with arrays `primitive` (0: none, then in
/// order) and `colour`. Throws Error(invalid_argument) for another extension.
void write_detected(const Mesh& mesh, const client::Detected& detected, const std::filesystem::path& path);

}  // namespace deform::cli
