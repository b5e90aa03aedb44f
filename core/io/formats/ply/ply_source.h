// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <string_view>

#include "core/io/formats/ply/ply_header.h"
#include "core/io/text/text_scanner.h"

namespace deform::io {

/// Reads the values of an ascii PLY file in order. Throws Error(invalid_argument) with the line.
class PlyTextSource {
 public:
  PlyTextSource(std::string_view bytes, const std::string& name, const PlyHeader& header);

  std::uint64_t left() const { return size_ - scanner_.position(); }
  /// The smallest size of a record of this element, in bytes.
  static std::uint64_t smallest_record(const PlyElement& element) { return 2 * element.properties.size(); }
  static std::uint64_t smallest_value(PlyType) { return 2; }
  /// The separator after the last value of a file may be missing.
  static constexpr std::uint64_t slack = 1;

  /// Moves to the next value and returns its byte offset.
  std::size_t next(PlyType type);
  double number(const char* what) { return scanner_.number(what); }
  std::int64_t integer(const char* what) { return scanner_.whole_integer(what); }
  void skip(PlyType type, std::uint64_t count);
  void end_record();
  bool at_end() { return !scanner_.next_in_file(); }
  [[noreturn]] void fail(const std::string& message) const { scanner_.fail(message); }
  [[noreturn]] void fail_at(std::size_t position, const std::string& message) const { scanner_.fail_at(position, message); }

 private:
  TextScanner scanner_;
  std::size_t size_;
};

/// Reads the values of a binary PLY file in order. Throws Error(invalid_argument) with the byte offset.
class PlyBinarySource {
 public:
  PlyBinarySource(std::string_view bytes, const std::string& name, const PlyHeader& header)
      : bytes_(bytes), name_(name), at_(header.end), order_(header.order) {}

  std::uint64_t left() const { return bytes_.size() - at_; }
  static std::uint64_t smallest_record(const PlyElement& element) { return element.smallest_bytes(); }
  static std::uint64_t smallest_value(PlyType type) { return size_of(type); }
  static constexpr std::uint64_t slack = 0;

  std::size_t next(PlyType type);
  double number(const char* what);
  std::int64_t integer(const char* what);
  void skip(PlyType type, std::uint64_t count);
  void end_record() {}
  /// A final line feed is ignored.
  bool at_end() const { return left() == 0 || (left() == 1 && bytes_[at_] == '\n'); }
  [[noreturn]] void fail(const std::string& message) const { fail_at(at_, message); }
  [[noreturn]] void fail_at(std::size_t position, const std::string& message) const;

 private:
  std::string_view bytes_;
  const std::string& name_;
  std::size_t at_;
  std::endian order_;
  PlyType type_{};  // type of the value at the cursor
};

}  // namespace deform::io
