// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/io/assembly/number_fields.h"
#include "core/io/text/deck_lines.h"

namespace deform::io {

/// A cursor over the bulk data entries ("cards") of a Nastran file in small, large and free field format, with continuation
/// lines, which follow the line that they continue. Everything before BEGIN BULK and after ENDDATA is skipped. Throws
/// Error(invalid_argument) with file and line. The bytes and the name must outlive it.
class NastranCards {
 public:
  NastranCards(std::string_view bytes, const std::string& name);

  /// Moves to the next card; returns false at ENDDATA or the end of the file.
  bool next();
  /// The name of the card in capitals, without the * of large fields.
  const std::string& name() const { return card_; }
  /// The position of the card.
  std::size_t position() const { return position_; }

  /// Reads the fields of this card, with its continuation lines.
  void read_fields();
  /// Field i of the card counted from 1 over all lines, without the fields of continuation marks. Blank beyond the last line.
  std::string_view text(std::size_t i) const { return i <= fields_.size() ? fields_[i - 1].text : std::string_view(); }
  /// Whether the field is blank, and the integer in it.
  bool blank(std::size_t i) const { return text(i).empty(); }
  std::int64_t integer(std::size_t i, const char* what) const;
  /// The number in the field; 0 if it is blank.
  double number(std::size_t i, const char* what) const;
  /// The position and format of the field.
  NumberField place(std::size_t i) const;

  [[noreturn]] void fail(const std::string& message) const { lines_.fail_at(position_, message); }
  [[noreturn]] void fail_at(std::size_t position, const std::string& message) const { lines_.fail_at(position, message); }

 private:
  struct Field {
    std::string_view text;
    NumberField place;
  };
  bool next_line();
  bool continues() const;
  void add_line();
  void add_fixed(std::size_t columns);
  void add_free(std::size_t most);
  void check_mark(std::string_view mark) const;

  DeckLines lines_;
  std::string_view content_;  // the line without comment
  bool ahead_ = false;        // the line is read, but not yet part of a card
  std::string card_;
  std::size_t position_ = 0;
  std::vector<Field> fields_;
  std::string_view mark_;  // at the end of the last line
  bool large_ = false;     // the last line
  bool free_ = false;
  std::size_t end_ = 0;  // end of the last line
};

}  // namespace deform::io
