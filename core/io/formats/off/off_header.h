// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "core/io/mesh_file.h"

namespace deform::io {

/// What the first line of an OFF file says (Geomview: [ST][C][N][4][n]OFF [BINARY]).
struct OffHeader {
  bool normals = false, colours = false, texture = false;
  bool binary = false;
  std::size_t end = 0;  ///< byte offset of what follows the header words (binary: of the first count)

  /// Numbers per vertex behind x, y, z.
  std::size_t extras() const { return (normals ? 3 : 0) + (colours ? 4 : 0) + (texture ? 2 : 0); }
};

/// The binary kind: 32-bit floats and counts, big-endian by definition, but little-endian and without the colour count of each
/// face in files of some programs; whatever fits the bytes exactly is taken.
std::unique_ptr<MeshFile> parse_off_binary(std::string bytes, const std::string& name, const OffHeader& header);

}  // namespace deform::io
