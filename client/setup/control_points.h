// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace deform::client {

/// Control points from a file, as little-endian doubles: the points of a mesh file (as `deform lattice` writes it) in their
/// order, or a CSV with the columns x, y, z and a line per control point, i fastest. Throws Error(not_found, invalid_argument)
/// naming the file.
std::string read_control_points(const std::filesystem::path& path);

}  // namespace deform::client
