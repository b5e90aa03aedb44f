// SPDX-License-Identifier: Apache-2.0
#include "core/io/text/deck_lines.h"

#include <algorithm>

#include "core/base/error.h"

namespace deform::io {

DeckLines::DeckLines(std::string_view bytes, const std::string& name) : bytes_(bytes), name_(name) {
  if (bytes.find('\n') == std::string_view::npos && bytes.find('\r') != std::string_view::npos) line_end_ = '\r';
  if (bytes.starts_with("\xef\xbb\xbf")) next_ = 3;  // byte order mark of UTF-8
}

bool DeckLines::next() {
  if (next_ >= bytes_.size()) return false;
  begin_ = next_;
  const std::size_t end = std::min(bytes_.find(line_end_, begin_), bytes_.size());
  next_ = end + 1;
  line_ = bytes_.substr(begin_, end - begin_);
  if (line_end_ == '\n' && line_.ends_with('\r')) line_.remove_suffix(1);
  return true;
}

void DeckLines::fail_at(std::size_t position, const std::string& message) const {
  const auto begin = bytes_.begin();
  const auto line = std::count(begin, begin + static_cast<std::ptrdiff_t>(std::min(position, bytes_.size())), line_end_) + 1;
  throw Error(ErrorCode::invalid_argument, name_ + ": line " + std::to_string(line) + ": " + message);
}

std::string_view trimmed(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

std::string in_quotes(std::string_view text) {
  constexpr std::size_t longest = 24;
  std::string shown = "\"";
  for (const char c : text.substr(0, longest)) shown += c >= ' ' && c <= '~' ? c : '?';
  return shown + (text.size() > longest ? "...\"" : "\"");
}

}  // namespace deform::io
