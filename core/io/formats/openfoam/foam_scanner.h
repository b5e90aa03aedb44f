// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace deform::io {

/// A cursor over an OpenFOAM file: words and punctuation ( ) { } ; without comments, and lists of labels in text or binary
/// according to the header. Throws Error(invalid_argument) with file and line. The bytes and the name must outlive it.
class FoamScanner {
 public:
  FoamScanner(std::string_view bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  /// Reads format and arch from the FoamFile dictionary, if the file begins with one.
  void read_header();
  bool binary() const { return binary_; }
  int scalar_bytes() const { return scalar_bytes_; }
  std::endian order() const { return order_; }

  std::size_t position() const { return at_; }
  void move_to(std::size_t position) { at_ = position; }
  std::size_t left() const { return bytes_.size() - at_; }

  /// Moves to the next token; returns false at the end of the file.
  bool next();
  /// The character at the cursor after skipping blanks and comments; 0 at the end.
  char peek();
  /// Steps over c or fails. `where` describes the context in the error ("the list of faces").
  void expect(char c, const char* where);
  bool accept(char c);
  /// Steps over a word, a quoted string or a number up to a blank or punctuation, and returns it as text.
  std::string_view word(const char* what);
  /// Skips to after the ; that ends this entry, or over its { } or ( ) blocks.
  void skip_entry();
  /// Skips a balanced block that begins at the cursor.
  void skip_block();

  double number(const char* what);
  std::int64_t integer(const char* what);
  /// An integer in 0..limit-1; otherwise fails naming value and limit.
  std::uint32_t index(const char* what, std::uint64_t limit);
  /// The number of entries of a list; fails if the file is too short for `least_bytes` per entry.
  std::size_t count(const char* what, std::size_t least_bytes);

  /// A list of at most `most` labels in 0..limit-1, written as N ( ... ), N { value } or binary. If allowed, -1 is returned
  /// as `minus_one`.
  enum class MinusOne { refused, allowed };
  static constexpr std::uint32_t minus_one = 0xffffffffu;
  std::vector<std::uint32_t> labels(const char* what, std::uint64_t limit, std::uint64_t most,
                                    MinusOne minus_one_is = MinusOne::refused);
  /// A list of labels of either sign.
  std::vector<std::int64_t> signed_labels(const char* what);
  /// After a count: steps over '(', returns the raw bytes of a binary list and steps over ')'.
  std::string_view raw(std::size_t bytes, const char* what);

  [[noreturn]] void fail(const std::string& message) const { fail_at(at_, message); }
  [[noreturn]] void fail_at(std::size_t position, const std::string& message) const;
  std::string quoted() const;

 private:
  void read_arch(std::string_view text);

  const std::string_view bytes_;
  const std::string& name_;
  std::size_t at_ = 0;
  bool binary_ = false;
  int label_bytes_ = 4, scalar_bytes_ = 8;
  std::endian order_ = std::endian::little;
};

}  // namespace deform::io
