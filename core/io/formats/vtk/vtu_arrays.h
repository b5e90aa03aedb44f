// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/formats/vtk/xml_tree.h"

namespace deform::io {

/// How the arrays of a VTK XML file are stored: what its VTKFile and AppendedData elements say.
struct VtuStorage {
  std::string name;  ///< of the file, for errors
  std::size_t header_bytes = 4;
  std::endian order = std::endian::little;
  std::string compressor;                      ///< empty: none
  std::size_t appended = 0, appended_end = 0;  ///< where offsets count from; 0: there is no appended data
  bool appended_base64 = false;
};

/// Where an array stands and what its values are.
struct VtuArray {
  enum class Kind { signed_integer, unsigned_integer, floating };
  enum class Form { ascii, base64, appended_base64, appended_raw };
  std::string title;  ///< DataArray "NAME", for errors
  Kind kind{};
  std::size_t value_bytes = 0;
  std::uint64_t components = 1;
  Form form{};
  std::size_t begin = 0, end = 0;  ///< of the text; where appended data may end at most
};

/// What a binary array holds, and how it is cut into compressed blocks.
struct VtuData {
  std::string values;         ///< in the byte order of the file
  std::size_t end = 0;        ///< byte offset behind it in the file
  bool header_apart = false;  ///< base64: the header is padded, a second text follows (always when compressed)
  std::uint64_t block_bytes = 0, last_bytes = 0;
  std::vector<std::string> blocks;  ///< as they are in the file; empty when not compressed
};

// All throw Error(invalid_argument) with file, line and array.

VtuStorage read_storage(std::string_view bytes, const std::string& name, const XmlNode& root);

/// Whether this is an array of numbers (strings are not).
bool is_numeric(std::string_view bytes, const XmlNode& node);
VtuArray find_array(std::string_view bytes, const VtuStorage& storage, const XmlNode& node);
/// Claimed sizes are checked against the bytes before anything is allocated.
VtuData decoded(std::string_view bytes, const VtuStorage& storage, const VtuArray& array);
/// Integers of any kind of storage. Sets where appended ones end.
std::vector<std::int64_t> integers(std::string_view bytes, const VtuStorage& storage, VtuArray& array);
/// `values` (of the same size) in the place of `old`; blocks that did not change keep their bytes.
std::string encoded(const VtuStorage& storage, const VtuArray& array, const VtuData& old, std::string_view values);

/// A number of an attribute: 0 or more. `fallback` where there is no such attribute.
std::uint64_t count_attribute(std::string_view bytes, const std::string& name, const XmlNode& node, std::string_view attribute,
                              std::uint64_t fallback);

}  // namespace deform::io
