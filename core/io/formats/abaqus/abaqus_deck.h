// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/text/deck_lines.h"

namespace deform::io {

/// The main file of an Abaqus deck, or an included one.
struct DeckFile {
  std::string name;                ///< name in errors
  std::string bytes;               ///< uncompressed
  std::filesystem::path input;     ///< as written in the deck; empty for the main file
  std::filesystem::path original;  ///< where it was read from
};

/// A cursor over the keyword and data lines of an Abaqus deck that handles comments, continued keyword lines and included files.
/// Source: Abaqus Analysis User's Guide, "Input syntax rules". Throws Error(invalid_argument) with file and line.
class AbaqusDeck {
 public:
  using Open = std::function<DeckFile(const std::string& input)>;
  enum class Kind { keyword, data };
  struct Field {
    std::string_view text;  ///< without blanks around it
    std::size_t at;         ///< its position in the file
  };

  /// `open` opens an included file; without it included files are an error.
  AbaqusDeck(DeckFile main, Open open);

  bool next();
  Kind kind() const { return kind_; }

  /// The keyword of a keyword line in capitals, without * and blanks.
  const std::string& keyword() const { return keyword_; }
  /// The value of a parameter (name in capitals) as written, without quotes; an empty string if it has no value.
  std::optional<std::string> parameter(const std::string& name) const;
  /// Continues with the lines of another file, then with those after this line.
  void include(const std::string& input);

  /// The comma-separated fields of a data line. A trailing comma adds no field.
  const std::vector<Field>& fields() const { return fields_; }
  bool ends_in_comma() const { return ends_in_comma_; }
  /// The position after the last nonblank character of the data line.
  std::size_t line_end() const { return line_end_; }

  /// The file of the line and its position there.
  std::uint32_t file() const { return stack_.back().file; }
  std::size_t position() const { return stack_.back().lines.begin(); }
  std::deque<DeckFile>& files() { return files_; }

  [[noreturn]] void fail(const std::string& message) const { stack_.back().lines.fail(message); }
  [[noreturn]] void fail_at(std::uint32_t file, std::size_t position, const std::string& message) const;

 private:
  struct Level {
    std::uint32_t file;
    DeckLines lines;
  };
  void push(DeckFile file);
  void read_keyword(std::string_view line);
  void add_parameters(std::string_view line);
  void read_fields();

  std::deque<DeckFile> files_;  // stay where they are
  std::vector<Level> stack_;
  Open open_;
  Kind kind_ = Kind::data;
  std::string keyword_;
  std::map<std::string, std::string> parameters_;
  std::vector<Field> fields_;
  bool ends_in_comma_ = false;
  std::size_t line_end_ = 0;
};

/// Parses the whole text as an integer.
std::optional<std::int64_t> parse_integer(std::string_view text);

}  // namespace deform::io
