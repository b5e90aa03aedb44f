// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace deform::io {

/// The lines of a text file, which end with LF, CR LF or CR (the last only in files without any LF). The bytes and the name must
/// outlive it.
class DeckLines {
 public:
  DeckLines(std::string_view bytes, const std::string& name);

  /// Moves to the next line; returns false at the end of the file.
  bool next();
  /// The line without its end.
  std::string_view line() const { return line_; }
  /// The positions of the first character of the line and of its line end.
  std::size_t begin() const { return begin_; }
  std::size_t end() const { return begin_ + line_.size(); }
  /// The position of the next line, for move_to().
  std::size_t next_begin() const { return next_; }
  /// Makes next() continue with the line at this position.
  void move_to(std::size_t position) { next_ = position; }

  std::string_view bytes() const { return bytes_; }
  const std::string& name() const { return name_; }
  [[noreturn]] void fail(const std::string& message) const { fail_at(begin_, message); }
  /// Throws Error(invalid_argument) "NAME: line L: MESSAGE", where L is the line of `position`.
  [[noreturn]] void fail_at(std::size_t position, const std::string& message) const;

 private:
  std::string_view bytes_;
  const std::string& name_;
  std::string_view line_;
  std::size_t begin_ = 0, next_ = 0;
  char line_end_ = '\n';
};

/// Removes blanks and tabs at both ends.
std::string_view trimmed(std::string_view text);
/// Quotes text for an error message, shortened and without control characters.
std::string in_quotes(std::string_view text);

}  // namespace deform::io
