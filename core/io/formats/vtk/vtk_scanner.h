// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/text/text_scanner.h"

namespace deform::io {

/// A type of the arrays of a legacy VTK file.
struct VtkType {
  std::string_view name;
  std::uint32_t bits;  ///< bits per value in a binary file; 0 for strings
  enum class Kind { signed_integer, unsigned_integer, floating, text } kind;
};

/// A cursor over a legacy VTK file: words, and arrays in text or big-endian binary. Throws Error(invalid_argument) with the line,
/// in binary files with the byte. The bytes and the name must outlive it.
class VtkScanner {
 public:
  VtkScanner(std::string_view bytes, const std::string& name)
      : bytes_(bytes), name_(name), scanner_(bytes, name, Syntax::plain) {}

  /// Reads the three lines before the data set.
  void read_header();
  int major_version() const { return major_version_; }
  bool binary() const { return binary_; }

  std::size_t position() const { return scanner_.position(); }
  std::uint64_t left() const { return bytes_.size() - position(); }
  bool at_end() { return !scanner_.next_in_file(); }
  /// The next word in lower case.
  std::string keyword(const char* what);
  /// The next word with percent-encoding decoded.
  std::string word(const char* what);
  std::uint64_t count(const char* what);
  /// A type, or nullptr if it is unknown.
  const VtkType* type();
  /// Whether another word follows on the line.
  bool more_in_line() { return scanner_.next_in_line(); }

  /// Before an array: checks that the file is large enough for that many values (no overflow) and steps to the first.
  void begin_array(const VtkType& type, std::uint64_t count, std::uint64_t components, const char* what);
  double number(const VtkType& type, const char* what);
  std::int64_t integer(const VtkType& type, const char* what);
  void skip_array(const VtkType& type, std::uint64_t count);
  /// Skips METADATA up to and including the next empty line.
  void skip_metadata();
  void move_to(std::size_t position) { scanner_.move_to(position); }

  [[noreturn]] void fail_at(std::size_t position, const std::string& message) const;

 private:
  void skip_string();

  const std::string_view bytes_;
  const std::string& name_;
  TextScanner scanner_;
  int major_version_ = 0;
  bool binary_ = false;
};

}  // namespace deform::io
