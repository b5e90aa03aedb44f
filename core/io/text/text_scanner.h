// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace deform::io {

/// Whether a character ends a number or a word: white space, a comment or a line continuation.
inline bool is_delimiter(char c) { return static_cast<unsigned char>(c) <= ' ' || c == '#' || c == '\\'; }

/// What may separate the words of a text format besides white space.
enum class Syntax {
  plain,    ///< nothing (STL, PLY)
  hash,     ///< # starts a comment that ends with the line (OFF)
  obj,      ///< as hash, and a backslash at the end of a line continues it
  percent,  ///< % starts a comment that ends with the line (SU2)
};

/// A cursor over the bytes of a text file that reads words and numbers in place and throws Error(invalid_argument) with file and
/// line. Lines end with LF, CR LF or CR (the last only in files without any LF). The bytes and the name must outlive it.
class TextScanner {
 public:
  TextScanner(std::string_view bytes, const std::string& name, Syntax syntax);

  std::size_t position() const { return static_cast<std::size_t>(at_ - begin_); }
  void move_to(std::size_t position) { at_ = begin_ + position; }

  /// Moves to the next word of this line; returns false at its end.
  bool next_in_line();
  /// Moves to the next word of the file; returns false at its end.
  bool next_in_file();
  /// Skips the rest of this line (in obj syntax with its continuations).
  void skip_line();
  /// Returns the rest of this line, trimmed; the cursor stays before the line end.
  std::string_view rest_of_line();

  char peek() const { return at_ == end_ ? '\0' : *at_; }
  void advance(std::size_t count) { at_ += count; }
  bool at_end() const { return at_ == end_; }

  /// Returns the word at the cursor, up to a delimiter, and steps over it.
  std::string_view word();
  /// Returns the name at the cursor, up to white space or a line continuation, and steps over it. Not empty after next_in_line().
  std::string_view name();
  /// Steps over the word at the cursor if it equals `lower_case`, ignoring case.
  bool accept(std::string_view lower_case);

  /// Returns the finite number at the cursor and steps over it. `what` is used in the error ("vertex coordinate").
  double number(const char* what);
  /// Returns the integer at the cursor and steps over it. Any character may follow.
  std::int64_t integer(const char* what);
  /// The same, but a delimiter must follow.
  std::int64_t whole_integer(const char* what);

  [[noreturn]] void fail(const std::string& message) const { fail_at(position(), message); }
  /// Throws Error(invalid_argument) "NAME: line L: MESSAGE", where L is the line of `position`.
  [[noreturn]] void fail_at(std::size_t position, const std::string& message) const;
  /// The word at the cursor quoted for an error message, shortened and without control characters, or "the end of the file".
  std::string quoted() const;

 private:
  bool is_blank(char c) const { return c == ' ' || c == '\t' || c == '\v' || c == '\f' || (c == '\r' && line_end_ != '\r'); }
  bool starts_comment(char c) const { return syntax_ == Syntax::percent ? c == '%' : syntax_ != Syntax::plain && c == '#'; }
  /// The position after the line end if the backslash at `at` continues the line, else nullptr.
  const char* behind_continuation(const char* at) const;
  double unusual_number(const char* first, const char* what) const;

  const char* begin_;
  const char* end_;
  const char* at_;
  const std::string& name_;
  Syntax syntax_;
  char line_end_;
};

}  // namespace deform::io
