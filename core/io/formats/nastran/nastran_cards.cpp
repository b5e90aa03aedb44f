// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/nastran/nastran_cards.h"

#include <algorithm>
#include <charconv>

#include "core/base/error.h"
#include "core/base/text.h"

namespace deform::io {

namespace {

constexpr std::size_t name_columns = 8, small_columns = 8, large_columns = 16, small_fields = 8, large_fields = 4;
constexpr std::size_t mark_begin = 72, mark_end = 80;

bool begins_bulk(std::string_view line) {
  const std::string upper = upper_case(trimmed(line.substr(0, line.find('$'))));
  return upper.starts_with("BEGIN") && trimmed(std::string_view(upper).substr(5)).starts_with("BULK");
}

/// The text after the + or * of a continuation mark.
std::string_view mark_name(std::string_view mark) {
  return mark.starts_with('+') || mark.starts_with('*') ? trimmed(mark.substr(1)) : mark;
}

bool is_mark(std::string_view text) {
  return (text.starts_with('+') || text.starts_with('*')) && !parse_decimal(text, DecimalStyle::nastran);
}

}  // namespace

NastranCards::NastranCards(std::string_view bytes, const std::string& name) : lines_(bytes, name) {
  const std::size_t start = lines_.next_begin();
  while (lines_.next()) {
    if (begins_bulk(lines_.line())) return;
  }
  lines_.move_to(start);  // a file of bulk data only
}

bool NastranCards::next_line() {
  while (lines_.next()) {
    const std::string_view line = lines_.line();
    content_ = line.substr(0, line.find('$'));
    if (!trimmed(content_).empty()) return true;
  }
  return false;
}

bool NastranCards::continues() const {
  const char first = content_[0];
  return first == '+' || first == '*' || first == ',' || trimmed(content_.substr(0, name_columns)).empty();
}

bool NastranCards::next() {
  // Lines that continue a card of no interest.
  while (ahead_ || next_line()) {
    ahead_ = false;
    if (content_[0] == '=') lines_.fail("replication of cards (=) is not supported");
    if (continues()) continue;
    position_ = lines_.begin();
    card_ = upper_case(trimmed(content_.substr(0, std::min(content_.find_first_of(",\t"), name_columns))));
    if (card_.ends_with('*')) card_ = trimmed(std::string_view(card_).substr(0, card_.size() - 1));
    if (card_ == "ENDDATA") return false;
    if (card_.starts_with("INCLUDE")) lines_.fail("INCLUDE is not supported: put the parts into one file");
    if (card_.starts_with("BEGIN")) lines_.fail("a second BEGIN: superelements are not supported");
    return true;
  }
  return false;
}

void NastranCards::read_fields() {
  fields_.clear();
  mark_ = {};
  add_line();
  while (next_line()) {
    if (!continues()) {
      ahead_ = true;
      return;
    }
    add_line();
  }
}

void NastranCards::add_line() {
  free_ = content_.find(',') != std::string_view::npos;
  const std::string_view first = trimmed(content_.substr(0, free_ ? content_.find(',') : name_columns));
  large_ = fields_.empty() ? first.ends_with('*') : first.starts_with('*');
  if (!fields_.empty()) check_mark(first);
  mark_ = {};
  if (free_) {
    add_free(large_ ? large_fields : small_fields);
  } else {
    if (content_.substr(0, mark_begin).find('\t') != std::string_view::npos) {
      lines_.fail("a tab among fields of fixed width: replace it by blanks");
    }
    add_fixed(large_ ? large_columns : small_columns);
  }
}

void NastranCards::check_mark(std::string_view mark) const {
  const std::string_view here = mark_name(mark), before = mark_name(mark_);
  if (here.empty() || before.empty() || here == before) return;
  lines_.fail("continuation " + in_quotes(mark) + " stands where " + in_quotes(mark_) + " continues");
}

void NastranCards::add_fixed(std::size_t columns) {
  end_ = lines_.begin() + content_.size();
  for (std::size_t begin = name_columns; begin < mark_begin; begin += columns) {
    Field field;
    field.place.kind = NumberField::Kind::fixed;
    field.place.width = static_cast<std::uint8_t>(columns);
    if (begin < content_.size()) {
      const std::string_view text = content_.substr(begin, columns);
      field.text = trimmed(text);
      field.place.at = lines_.begin() + begin;
      field.place.length = static_cast<std::uint16_t>(text.size());
    } else {
      field.place.at = end_;
      field.place.missing = static_cast<std::uint16_t>(begin - content_.size());
    }
    fields_.push_back(field);
  }
  if (content_.size() > mark_begin) mark_ = trimmed(content_.substr(mark_begin, mark_end - mark_begin));
}

void NastranCards::add_free(std::size_t most) {
  constexpr std::uint8_t longest_small = 8, longest_large = 16;
  std::string_view content = content_;
  while (content.back() == ' ' || content.back() == '\t') content.remove_suffix(1);
  end_ = lines_.begin() + content.size();
  NumberField place;
  place.width = large_ ? longest_large : longest_small;
  std::size_t number = 0, begin = content.find(',') + 1;
  for (bool more = true; more; ++number) {
    const std::size_t comma = std::min(content.find(',', begin), content.size());
    more = comma < content.size();
    const std::string_view text = trimmed(content.substr(begin, comma - begin));
    if (number >= most) {
      if (number == most && is_mark(text)) {
        mark_ = text;
      } else if (!text.empty()) {
        lines_.fail("more than " + std::to_string(most) + " fields on a line between commas, found " + in_quotes(text));
      }
    } else if (!more && is_mark(text)) {  // of a line that ends early
      mark_ = text;
      end_ = lines_.begin() + begin - 1;  // missing fields are inserted before its comma
      break;
    } else {
      place.at = text.empty() ? lines_.begin() + begin : lines_.begin() + static_cast<std::size_t>(text.data() - content_.data());
      if (text.size() > 0xffff) lines_.fail("a field of " + std::to_string(text.size()) + " characters");
      place.length = static_cast<std::uint16_t>(text.size());
      fields_.push_back({text, place});
    }
    begin = comma + 1;
  }
  for (std::uint16_t missing = 1; number < most; ++number, ++missing) {
    place.at = end_;
    place.length = 0;
    place.missing = missing;
    fields_.push_back({{}, place});
  }
}

std::int64_t NastranCards::integer(std::size_t i, const char* what) const {
  const std::string_view field = text(i);
  std::string_view digits = field;
  if (digits.starts_with('+')) digits.remove_prefix(1);
  std::int64_t value = 0;
  const auto [end, status] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (status != std::errc{} || end != digits.data() + digits.size()) {
    fail(card_ + ": expected an integer as " + what + " in field " + std::to_string(i + 1) + ", found " + in_quotes(field));
  }
  return value;
}

double NastranCards::number(std::size_t i, const char* what) const {
  const std::string_view field = text(i);
  if (field.empty()) return 0;
  const auto value = parse_decimal(field, DecimalStyle::nastran);
  if (!value) {
    fail(card_ + ": expected a finite number as " + what + " in field " + std::to_string(i + 1) + ", found " + in_quotes(field));
  }
  return *value;
}

NumberField NastranCards::place(std::size_t i) const {
  if (i <= fields_.size()) return fields_[i - 1].place;
  NumberField place;
  place.at = end_;
  place.new_line = true;
  place.kind = free_ ? NumberField::Kind::free : NumberField::Kind::fixed;
  place.missing = free_ ? 1 : name_columns - 1;
  place.width = large_columns;
  return place;
}

}  // namespace deform::io
