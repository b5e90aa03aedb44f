// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "core/io/mesh_file.h"

namespace deform::io {

/// The header of an OFF file (Geomview: [ST][C][N][4][n]OFF [BINARY]).
struct OffHeader {
  bool normals = false, colours = false, texture = false;
  bool binary = false;
  std::size_t end = 0;  ///< byte offset after the header words (binary: of the first count)

  /// The number of values per vertex after x, y, z.
  std::size_t extras() const { return (normals ? 3 : 0) + (colours ? 4 : 0) + (texture ? 2 : 0); }
};

/// Parses the binary variant: 32-bit floats and counts, big-endian by definition, but little-endian and without the colour count
/// of each face in files of some programs. Uses the variant that matches the size of the file exactly.
std::unique_ptr<MeshFile> parse_off_binary(std::string bytes, const std::string& name, const OffHeader& header);

}  // namespace deform::io
