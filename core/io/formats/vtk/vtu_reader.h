// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/io/assembly/coordinate_records.h"
#include "core/io/formats/vtk/vtk_cells.h"
#include "core/io/formats/vtk/vtu_arrays.h"

namespace deform::io {

/// The points of one piece, and the values in the file that depend on them.
struct VtuPoints {
  VtuArray array;
  std::size_t first = 0, count = 0;
  std::vector<CoordinateTokens> tokens;  ///< positions in a text array
  struct Range {
    std::size_t begin, end;  ///< byte offsets of the number
    enum class Bound { least, largest } bound;
  };
  std::vector<Range> ranges;  ///< ranges of the distances from the origin
};

/// A number in the file that counts bytes of appended data.
struct VtuOffset {
  std::size_t begin, end;
  std::uint64_t value;
};

struct VtuContent {
  VtuStorage storage;
  std::vector<VtuPoints> pieces;
  std::vector<VtuOffset> offsets;
  ElementMesh mesh;
};

/// Reads an UnstructuredGrid or a PolyData file (`type`). Throws Error(invalid_argument) naming file, line and array.
VtuContent read_vtu(std::string_view bytes, const std::string& name, std::string_view type);

/// Loads one coordinate from its first byte.
double load_coordinate(const char* at, const VtuStorage& storage, const VtuArray& array);

}  // namespace deform::io
