// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace deform::io {

enum class PlyType { int8, uint8, int16, uint16, int32, uint32, float32, float64 };

/// The size of a value in a binary file: 1, 2, 4 or 8 bytes.
std::size_t size_of(PlyType type);
bool is_integer(PlyType type);
const char* to_string(PlyType type);

struct PlyProperty {
  std::string name;
  PlyType type{};                  ///< type of the scalar or of the list entries
  std::optional<PlyType> counted;  ///< type of the length of a list; not set for a scalar
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
  std::size_t line = 0;  ///< line of the element statement, for errors

  /// The index of the property with this name, or -1.
  int find(std::string_view property) const;
  /// Whether all properties are scalars.
  bool fixed_size() const;
  /// The smallest size of a record in a binary file, with empty lists.
  std::uint64_t smallest_bytes() const;
};

struct PlyHeader {
  bool binary = false;
  std::endian order = std::endian::little;
  std::vector<PlyElement> elements;
  std::size_t end = 0;  ///< byte offset of the data
};

/// Parses the header. Throws Error(invalid_argument) with file and line.
PlyHeader read_ply_header(std::string_view bytes, const std::string& name);

}  // namespace deform::io
