// SPDX-License-Identifier: Apache-2.0
#include "core/io/text/text_scanner.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "core/base/error.h"

namespace deform::io {

TextScanner::TextScanner(std::string_view bytes, const std::string& name, Syntax syntax)
    : begin_(bytes.data()), end_(begin_ + bytes.size()), at_(begin_), name_(name), syntax_(syntax) {
  const bool has_lf = !bytes.empty() && std::memchr(begin_, '\n', bytes.size()) != nullptr;
  line_end_ = has_lf || bytes.find('\r') == std::string_view::npos ? '\n' : '\r';
  if (bytes.substr(0, 3) == "\xef\xbb\xbf") at_ += 3;  // byte order mark of UTF-8
}

const char* TextScanner::behind_continuation(const char* at) const {
  if (syntax_ != Syntax::obj || *at != '\\') return nullptr;
  const char* next = at + 1;
  if (next != end_ && *next == '\r' && line_end_ == '\n') ++next;
  return next != end_ && *next == line_end_ ? next + 1 : nullptr;
}

bool TextScanner::next_in_line() {
  while (at_ != end_) {
    if (is_blank(*at_)) {
      ++at_;
    } else if (const char* next = behind_continuation(at_)) {
      at_ = next;
    } else {
      return *at_ != line_end_ && !starts_comment(*at_);
    }
  }
  return false;
}

bool TextScanner::next_in_file() {
  while (!next_in_line()) {
    if (at_ == end_) return false;
    skip_line();
  }
  return true;
}

void TextScanner::skip_line() {
  const bool comment = at_ != end_ && starts_comment(*at_);
  while (at_ != end_) {
    const char* line_end = static_cast<const char*>(std::memchr(at_, line_end_, static_cast<std::size_t>(end_ - at_)));
    if (!line_end) {
      at_ = end_;
      return;
    }
    const char* last = line_end;  // one past the last character of the line proper
    if (last != at_ && line_end_ == '\n' && last[-1] == '\r') --last;
    const bool continued = syntax_ == Syntax::obj && !comment && last != at_ && last[-1] == '\\' &&
                           !std::memchr(at_, '#', static_cast<std::size_t>(last - at_));
    at_ = line_end + 1;
    if (!continued) return;
  }
}

std::string_view TextScanner::rest_of_line() {
  const char* first = at_;
  while (first != end_ && is_blank(*first)) ++first;
  at_ = std::find(first, end_, line_end_);
  const char* last = at_;
  while (last != first && is_blank(last[-1])) --last;
  return {first, static_cast<std::size_t>(last - first)};
}

std::string_view TextScanner::word() {
  const char* first = at_;
  while (at_ != end_ && !is_delimiter(*at_)) ++at_;
  return {first, static_cast<std::size_t>(at_ - first)};
}

std::string_view TextScanner::name() {
  const char* first = at_;
  while (at_ != end_ && *at_ != line_end_ && !is_blank(*at_) && !behind_continuation(at_)) ++at_;
  return {first, static_cast<std::size_t>(at_ - first)};
}

bool TextScanner::accept(std::string_view lower_case) {
  if (static_cast<std::size_t>(end_ - at_) < lower_case.size()) return false;
  for (std::size_t i = 0; i < lower_case.size(); ++i) {
    const char c = at_[i];
    if ((c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c) != lower_case[i]) return false;
  }
  const char* after = at_ + lower_case.size();
  if (after != end_ && !is_delimiter(*after)) return false;
  at_ = after;
  return true;
}

double TextScanner::number(const char* what) {
  const char* first = at_;
  if (first != end_ && *first == '+' && first + 1 != end_ && first[1] != '-') ++first;
  double value = 0;
  const auto [after, status] = std::from_chars(first, end_, value);
  if (status == std::errc::result_out_of_range) {
    value = unusual_number(first, what);
  } else if (status != std::errc{} || (after != end_ && !is_delimiter(*after))) {
    fail(std::string("expected a number as ") + what + ", found " + quoted());
  }
  if (!std::isfinite(value)) fail(std::string(what) + " " + quoted() + " is not a finite number");
  at_ = after;
  return value;
}

double TextScanner::unusual_number(const char* first, const char* what) const {
  // from_chars says "out of range" for tiny numbers too; strtod rounds those to zero or a denormal.
  constexpr std::size_t longest = 4096;
  const char* last = first;
  while (last != end_ && !is_delimiter(*last)) ++last;
  if (static_cast<std::size_t>(last - first) > longest) fail(std::string(what) + " " + quoted() + " is too long for a number");
  const std::string text(first, last);
  char* stop = nullptr;
  const double value = std::strtod(text.c_str(), &stop);
  if (*stop != '\0') fail(std::string("expected a number as ") + what + ", found " + quoted());
  return value;
}

std::int64_t TextScanner::integer(const char* what) {
  const char* first = at_;
  if (first != end_ && *first == '+' && first + 1 != end_ && first[1] != '-') ++first;
  std::int64_t value = 0;
  const auto [after, status] = std::from_chars(first, end_, value);
  if (status != std::errc{}) fail(std::string("expected an integer as ") + what + ", found " + quoted());
  at_ = after;
  return value;
}

std::int64_t TextScanner::whole_integer(const char* what) {
  const std::size_t start = position();
  const std::int64_t value = integer(what);
  if (at_ != end_ && !is_delimiter(*at_)) {
    move_to(start);
    fail(std::string("expected an integer as ") + what + ", found " + quoted());
  }
  return value;
}

void TextScanner::fail_at(std::size_t position, const std::string& message) const {
  const auto line = std::count(begin_, begin_ + position, line_end_) + 1;
  throw Error(ErrorCode::invalid_argument, name_ + ": line " + std::to_string(line) + ": " + message);
}

std::string TextScanner::quoted() const {
  constexpr std::size_t longest = 24;
  if (at_ == end_) return "the end of the file";
  std::string text;
  const char* c = at_;
  for (; c != end_ && !is_delimiter(*c) && text.size() < longest; ++c) text += *c >= ' ' && *c <= '~' ? *c : '?';
  if (text.empty()) return *at_ == '#' || *at_ == '\\' ? std::string("\"") + *at_ + "\"" : "the end of the line";
  return "\"" + text + (c != end_ && !is_delimiter(*c) ? "...\"" : "\"");
}

}  // namespace deform::io
