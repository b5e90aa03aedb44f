// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/mesh_file.h"
#include "core/io/text/fitted_decimal.h"

namespace deform::io {

/// The position of a coordinate in a text file of fields, and the limits of its replacement.
struct NumberField {
  enum class Kind : std::uint8_t {
    free,   ///< between commas
    fixed,  ///< in columns
  };
  std::uint64_t at = 0;       ///< first byte to replace
  std::uint16_t length = 0;   ///< number of bytes to replace
  std::uint16_t missing = 0;  ///< commas (free) or blanks (fixed) to insert before it if the line ends early
  std::uint8_t width = 0;     ///< largest number of characters; for a fixed field its columns
  Kind kind = Kind::free;
  bool new_line = false;  ///< its line is missing: insert a line end, * and blanks first
};

struct FieldRecord {
  PointId point = 0;
  std::array<NumberField, 3> axes;
};

/// Replaces the coordinates in which `after` differs from `before`. Records are in the order of the file. Throws
/// Error(invalid_argument) for a coordinate that does not fit.
std::string with_number_fields(std::string_view bytes, std::span<const FieldRecord> records, std::span<const Vec3> before,
                               std::span<const Vec3> after, DecimalStyle style);

/// A mesh file that consists of one such text.
std::unique_ptr<MeshFile> make_field_mesh_file(Format format, std::string bytes, std::shared_ptr<const Mesh> mesh,
                                               std::vector<FieldRecord> records, DecimalStyle style);

}  // namespace deform::io
