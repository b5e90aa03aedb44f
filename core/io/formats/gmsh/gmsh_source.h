// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <string_view>

#include "core/io/text/text_scanner.h"

namespace deform::io {

/// A cursor over a Gmsh MSH file of version 2, 4.0 or 4.1: sections, and the values of $Entities, $Nodes and $Elements in text or
/// binary according to the header. Throws Error(invalid_argument) with file and line, in binary files with file and byte. The
/// bytes and the name must outlive it. Source: Gmsh reference manual, "MSH file format" and "Legacy formats".
class GmshSource {
 public:
  enum class Version { v2, v4_0, v4_1 };

  /// Reads $MeshFormat, which comes first.
  GmshSource(std::string_view bytes, const std::string& name);

  Version version() const { return version_; }
  bool binary() const { return binary_; }
  std::endian order() const { return order_; }

  /// Moves to the values of the next section, whose name is section(); returns false at the end of the file.
  bool next_section();
  const std::string& section() const { return section_; }
  /// Declares that the values of this section are binary in a binary file; in version 2 they follow a count in text.
  void begin_values();
  /// Ends the section: its $End... must follow.
  void end_section();
  /// Skips everything up to and including its $End....
  void skip_section();

  /// An int.
  std::int64_t integer(const char* what);
  /// A count: size_t, or an integer in text in version 2.
  std::uint64_t size(const char* what);
  /// The same; fails if the rest of the file is too short for this number of items with these minimum sizes in bytes.
  std::size_t count(const char* what, std::size_t least_text, std::size_t least_binary);
  /// The tag of a node or element: size_t in version 4.1, else int.
  std::int64_t tag(const char* what);
  double number(const char* what);
  /// The position of the next value.
  std::size_t value_position();
  std::size_t tag_bytes() const { return version_ == Version::v4_1 ? size_bytes_ : 4; }
  std::size_t size_bytes() const { return size_bytes_; }

  /// The scanner for sections that are text in every file.
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
