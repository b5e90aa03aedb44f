// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>

#include "core/mesh/mesh.h"

namespace deform::io {

using Colour = std::array<unsigned char, 3>;  ///< red, green, blue

/// The faces of a mesh, each in its colour, as PLY 1.0 (binary, little-endian; coordinates as double, ids as uint, properties
/// red, green, blue of the faces). Points and faces keep their order. Throws Error(invalid_argument) when there is not one colour
/// for every face or a face has more than 255 corners, and what writing files throws.
void write_coloured_ply(const Mesh& mesh, std::span<const Colour> colours, const std::filesystem::path& path);
std::string coloured_ply_bytes(const Mesh& mesh, std::span<const Colour> colours);

/// The same with one colour for every point: properties red, green, blue of the vertices.
void write_point_coloured_ply(const Mesh& mesh, std::span<const Colour> colours, const std::filesystem::path& path);
std::string point_coloured_ply_bytes(const Mesh& mesh, std::span<const Colour> colours);

}  // namespace deform::io
