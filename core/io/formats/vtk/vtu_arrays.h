// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/formats/vtk/xml_tree.h"

namespace deform::io {

/// How the arrays of a VTK XML file are stored, according to its VTKFile and AppendedData elements.
struct VtuStorage {
  std::string name;  ///< name of the file, for errors
  std::size_t header_bytes = 4;
  std::endian order = std::endian::little;
  std::string compressor;                      ///< empty if none
  std::size_t appended = 0, appended_end = 0;  ///< origin of offsets and end; 0 without appended data
  bool appended_base64 = false;
};

/// The position and type of an array.
struct VtuArray {
  enum class Kind { signed_integer, unsigned_integer, floating };
  enum class Form { ascii, base64, appended_base64, appended_raw };
  std::string title;  ///< DataArray "NAME", for errors
  Kind kind{};
  std::size_t value_bytes = 0;
  std::uint64_t components = 1;
  Form form{};
  std::size_t begin = 0, end = 0;  ///< range of the text; for appended data `end` is an upper bound
};

/// The content of a binary array and its compressed blocks.
struct VtuData {
  std::string values;         ///< in the byte order of the file
  std::size_t end = 0;        ///< byte offset after it in the file
  bool header_apart = false;  ///< base64: the header is padded and a second text follows (always if compressed)
  std::uint64_t block_bytes = 0, last_bytes = 0;
  std::vector<std::string> blocks;  ///< as in the file; empty if not compressed
};

// All throw Error(invalid_argument) with file, line and array.

VtuStorage read_storage(std::string_view bytes, const std::string& name, const XmlNode& root);

/// Whether the node is an array of numbers and not of strings.
bool is_numeric(std::string_view bytes, const XmlNode& node);
VtuArray find_array(std::string_view bytes, const VtuStorage& storage, const XmlNode& node);
/// Claimed sizes are checked against the bytes before anything is allocated.
VtuData decoded(std::string_view bytes, const VtuStorage& storage, const VtuArray& array);
/// Integers in any kind of storage. Sets the end of an appended array.
std::vector<std::int64_t> integers(std::string_view bytes, const VtuStorage& storage, VtuArray& array);
/// Encodes `values` (of the same size) to replace `old`; unchanged blocks keep their bytes.
std::string encoded(const VtuStorage& storage, const VtuArray& array, const VtuData& old, std::string_view values);

/// The nonnegative number in an attribute, or `fallback` if there is no such attribute.
std::uint64_t count_attribute(std::string_view bytes, const std::string& name, const XmlNode& node, std::string_view attribute,
                              std::uint64_t fallback);

}  // namespace deform::io
