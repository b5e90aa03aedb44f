// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/abaqus/abaqus_deck.h"

#include <charconv>

#include "core/base/error.h"
#include "core/base/text.h"

namespace deform::io {

namespace {

constexpr std::size_t deepest_include = 10, most_files = 10000;

std::string without_blanks(std::string_view text) {
  std::string result;
  for (const char c : text) {
    if (c != ' ' && c != '\t') result += c;
  }
  return result;
}

std::string without_quotes(std::string_view text) {
  text = trimmed(text);
  if (text.size() >= 2 && (text.front() == '"' || text.front() == '\'') && text.back() == text.front()) {
    text = text.substr(1, text.size() - 2);
  }
  return std::string(text);
}

/// Where the next comma outside quotes is, or the end.
std::size_t next_comma(std::string_view text, std::size_t begin) {
  char quote = 0;
  for (; begin < text.size(); ++begin) {
    const char c = text[begin];
    if (quote != 0) {
      if (c == quote) quote = 0;
    } else if (c == '"') {
      quote = c;
    } else if (c == ',') {
      break;
    }
  }
  return begin;
}

}  // namespace

AbaqusDeck::AbaqusDeck(DeckFile main, Open open) : open_(std::move(open)) { push(std::move(main)); }

void AbaqusDeck::push(DeckFile file) {
  files_.push_back(std::move(file));
  const DeckFile& stored = files_.back();
  stack_.push_back({static_cast<std::uint32_t>(files_.size() - 1), DeckLines(stored.bytes, stored.name)});
}

void AbaqusDeck::include(const std::string& input) {
  if (input.empty()) fail("*" + keyword_ + " without the name of a file");
  if (!open_) fail("the file includes " + in_quotes(input) + ", which cannot be opened for a mesh in memory");
  if (stack_.size() > deepest_include)
    fail("files included more than " + std::to_string(deepest_include) + " deep, by " + in_quotes(input));
  if (files_.size() >= most_files) fail("more than " + std::to_string(most_files) + " files are included");
  try {
    push(open_(input));
  } catch (const Error& error) {
    if (error.code() == ErrorCode::not_found) fail("an included file: " + std::string(error.what()));
    throw;
  }
}

bool AbaqusDeck::next() {
  while (true) {
    if (!stack_.back().lines.next()) {
      if (stack_.size() == 1) return false;
      stack_.pop_back();
      continue;
    }
    const std::string_view line = trimmed(stack_.back().lines.line());
    if (line.empty() || line.starts_with("**")) continue;
    if (!line.starts_with('*')) {
      kind_ = Kind::data;
      read_fields();
      return true;
    }
    kind_ = Kind::keyword;
    read_keyword(line);
    if (keyword_ != "INCLUDE") return true;
    include(parameter("INPUT").value_or(""));
  }
}

void AbaqusDeck::read_keyword(std::string_view line) {
  const std::size_t end = next_comma(line, 0);
  keyword_ = upper_case(without_blanks(line.substr(1, end - 1)));
  parameters_.clear();
  add_parameters(line.substr(std::min(end + 1, line.size())));
  DeckLines& lines = stack_.back().lines;
  while (line.ends_with(',')) {
    const std::size_t next_begin = lines.next_begin();
    if (!lines.next()) break;
    line = trimmed(lines.line());
    if (line.starts_with('*') && !line.starts_with("**")) {  // the comma was one too many
      lines.move_to(next_begin);
      break;
    }
    if (line.starts_with("**")) {
      line = ",";
    } else {
      add_parameters(line);
    }
  }
}

void AbaqusDeck::add_parameters(std::string_view line) {
  for (std::size_t begin = 0; begin < line.size();) {
    const std::size_t end = next_comma(line, begin);
    const std::string_view part = trimmed(line.substr(begin, end - begin));
    begin = end + 1;
    if (part.empty()) continue;
    const std::size_t equals = std::min(part.find('='), part.size());
    parameters_[upper_case(without_blanks(part.substr(0, equals)))] =
        equals < part.size() ? without_quotes(part.substr(equals + 1)) : std::string();
  }
}

std::optional<std::string> AbaqusDeck::parameter(const std::string& name) const {
  const auto found = parameters_.find(name);
  return found == parameters_.end() ? std::nullopt : std::optional(found->second);
}

void AbaqusDeck::read_fields() {
  const DeckLines& lines = stack_.back().lines;
  const std::string_view line = trimmed(lines.line());
  const std::size_t offset = static_cast<std::size_t>(line.data() - lines.bytes().data());
  line_end_ = offset + line.size();
  ends_in_comma_ = line.ends_with(',');
  fields_.clear();
  for (std::size_t begin = 0; begin < line.size();) {
    const std::size_t end = next_comma(line, begin);
    const std::string_view text = trimmed(line.substr(begin, end - begin));
    fields_.push_back({text, text.empty() ? offset + begin : static_cast<std::size_t>(text.data() - lines.bytes().data())});
    begin = end + 1;
  }
}

void AbaqusDeck::fail_at(std::uint32_t file, std::size_t position, const std::string& message) const {
  DeckLines(files_[file].bytes, files_[file].name).fail_at(position, message);
}

std::optional<std::int64_t> parse_integer(std::string_view text) {
  if (text.starts_with('+') && !text.starts_with("+-")) text.remove_prefix(1);
  std::int64_t value = 0;
  const auto [end, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  return status == std::errc{} && end == text.data() + text.size() ? std::optional(value) : std::nullopt;
}

}  // namespace deform::io
