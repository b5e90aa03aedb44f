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

/// The file of an Abaqus deck, or one that it includes.
struct DeckFile {
  std::string name;                ///< stands in errors
  std::string bytes;               ///< unpacked
  std::filesystem::path input;     ///< as the deck names it; of the deck itself empty
  std::filesystem::path original;  ///< where it was read from
};

/// A cursor over the keyword and data lines of an Abaqus deck: comments, continued keyword lines and included files are taken
/// care of. Source: Abaqus Analysis User's Guide, "Input syntax rules". Throws Error(invalid_argument) with file and line.
class AbaqusDeck {
 public:
  using Open = std::function<DeckFile(const std::string& input)>;
  enum class Kind { keyword, data };
  struct Field {
    std::string_view text;  ///< without blanks around it
    std::size_t at;         ///< where that begins in the file
  };

  /// `open` gives the file of that name; without it included files are refused.
  AbaqusDeck(DeckFile main, Open open);

  bool next();
  Kind kind() const { return kind_; }

  /// Of a keyword line: the keyword in capitals, without * and blanks.
  const std::string& keyword() const { return keyword_; }
  /// The value of the parameter (name in capitals) as it is written, without quotes; empty when it has none.
  std::optional<std::string> parameter(const std::string& name) const;
  /// Goes on with the lines of another file; those behind this line follow.
  void include(const std::string& input);

  /// Of a data line: between commas. A comma at the end adds no field.
  const std::vector<Field>& fields() const { return fields_; }
  bool ends_in_comma() const { return ends_in_comma_; }
  /// Behind the last character of the data line that is not blank.
  std::size_t line_end() const { return line_end_; }

  /// The file of the line, and where the line begins in it.
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

/// The whole text as an integer.
std::optional<std::int64_t> parse_integer(std::string_view text);

}  // namespace deform::io
