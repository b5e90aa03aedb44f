// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>

#include "core/mesh/mesh.h"

namespace deform::io {

using Colour = std::array<unsigned char, 3>;  ///< red, green, blue

/// Writes a mesh with one colour for each face as PLY 1.0 (binary, little-endian; coordinates as double, ids as uint, face
/// properties red, green, blue). Points and faces keep their order. Throws Error(invalid_argument) if the number of colours is
/// not that of faces or a face has more than 255 corners, and the errors of write_file().
void write_coloured_ply(const Mesh& mesh, std::span<const Colour> colours, const std::filesystem::path& path);
std::string coloured_ply_bytes(const Mesh& mesh, std::span<const Colour> colours);

/// The same with one colour for each point, as vertex properties red, green, blue.
void write_point_coloured_ply(const Mesh& mesh, std::span<const Colour> colours, const std::filesystem::path& path);
std::string point_coloured_ply_bytes(const Mesh& mesh, std::span<const Colour> colours);

}  // namespace deform::io
