// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <string_view>

#include "core/io/text/text_scanner.h"

namespace deform::io {

/// A cursor over a Gmsh MSH file of version 2, 4.0 or 4.1: sections, and the values of $Entities, $Nodes and $Elements in text or
/// in binary as the header says. Throws Error(invalid_argument) with file and line, in binary files with file and byte. The bytes
/// and the name must outlive it. Source: Gmsh reference manual, "MSH file format" and "Legacy formats".
class GmshSource {
 public:
  enum class Version { v2, v4_0, v4_1 };

  /// Reads $MeshFormat, which comes first.
  GmshSource(std::string_view bytes, const std::string& name);

  Version version() const { return version_; }
  bool binary() const { return binary_; }
  std::endian order() const { return order_; }

  /// To the values of the next section, whose name is section(); false at the end of the file.
  bool next_section();
  const std::string& section() const { return section_; }
  /// The values of this section are binary in a binary file; in version 2 a count in text comes before them.
  void begin_values();
  /// All values of the section are read: its $End... must follow.
  void end_section();
  /// To behind its $End..., whatever comes before that.
  void skip_section();

  /// An int.
  std::int64_t integer(const char* what);
  /// What counts something: size_t; in version 2 an integer in text.
  std::uint64_t size(const char* what);
  /// The same, refused when the rest of the file is too short for so many items of that many bytes each at least.
  std::size_t count(const char* what, std::size_t least_text, std::size_t least_binary);
  /// The tag of a node or element: size_t in version 4.1, else int.
  std::int64_t tag(const char* what);
  double number(const char* what);
  /// Where the next value stands.
  std::size_t value_position();
  std::size_t tag_bytes() const { return version_ == Version::v4_1 ? size_bytes_ : 4; }
  std::size_t size_bytes() const { return size_bytes_; }

  /// To be used in sections that are text in every file.
  TextScanner& text() { return scanner_; }

  [[noreturn]] void fail(const std::string& message) const { fail_at(scanner_.position(), message); }
  [[noreturn]] void fail_at(std::size_t position, const std::string& message) const;

 private:
  void read_format();
  void read_order();
  std::uint64_t raw(std::size_t bytes, const char* what);
  std::size_t left() const { return bytes_.size() - scanner_.position(); }

  const std::string_view bytes_;
  const std::string& name_;
  TextScanner scanner_;
  std::string section_;
  Version version_ = Version::v4_1;
  bool binary_ = false;
  bool raw_values_ = false;  // values of this section are binary
  std::endian order_ = std::endian::little;
  std::size_t size_bytes_ = 8;
};

}  // namespace deform::io
