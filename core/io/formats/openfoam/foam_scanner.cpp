// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/openfoam/foam_scanner.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>

#include "core/base/error.h"
#include "core/io/binary/byte_order.h"

namespace deform::io {

namespace {

bool is_blank(char c) { return static_cast<unsigned char>(c) <= ' '; }
bool is_punctuation(char c) { return c == '(' || c == ')' || c == '{' || c == '}' || c == ';' || c == '[' || c == ']'; }

}  // namespace

bool FoamScanner::next() {
  while (at_ < bytes_.size()) {
    if (is_blank(bytes_[at_])) {
      ++at_;
    } else if (bytes_.substr(at_, 2) == "//") {
      at_ = std::min(bytes_.find('\n', at_), bytes_.size());
    } else if (bytes_.substr(at_, 2) == "/*") {
      const std::size_t end = bytes_.find("*/", at_ + 2);
      if (end == std::string_view::npos) fail("a comment that does not end");
      at_ = end + 2;
    } else {
      return true;
    }
  }
  return false;
}

char FoamScanner::peek() { return next() ? bytes_[at_] : '\0'; }

bool FoamScanner::accept(char c) {
  if (peek() != c) return false;
  ++at_;
  return true;
}

void FoamScanner::expect(char c, const char* where) {
  if (!accept(c)) fail(std::string("expected \"") + c + "\" in " + where + ", found " + quoted());
}

std::string_view FoamScanner::word(const char* what) {
  if (!next() || is_punctuation(bytes_[at_])) fail(std::string("expected ") + what + ", found " + quoted());
  const std::size_t begin = at_;
  if (bytes_[at_] == '"') {
    const std::size_t end = bytes_.find('"', at_ + 1);
    if (end == std::string_view::npos) fail("a text that does not end");
    at_ = end + 1;
    return bytes_.substr(begin + 1, end - begin - 1);
  }
  while (at_ < bytes_.size() && !is_blank(bytes_[at_]) && !is_punctuation(bytes_[at_])) ++at_;
  return bytes_.substr(begin, at_ - begin);
}

void FoamScanner::skip_block() {
  std::size_t depth = 0;
  do {
    const char c = peek();
    if (c == '\0') fail("a block that does not end");
    if (is_punctuation(c)) {
      depth += c == '(' || c == '{' ? 1u : 0u;
      depth -= c == ')' || c == '}' ? 1u : 0u;
      ++at_;
    } else {
      word("a word");
    }
  } while (depth > 0);
}

void FoamScanner::skip_entry() {
  for (;;) {
    const char c = peek();
    if (c == ';') {
      ++at_;
      return;
    }
    if (c == '{') return skip_block();
    if (c == '(') {
      skip_block();
    } else if (c == '\0' || c == '}' || c == ')') {
      fail("expected \";\" at the end of an entry, found " + quoted());
    } else if (is_punctuation(c)) {
      ++at_;
    } else {
      word("a value");
    }
  }
}

void FoamScanner::read_header() {
  if (!next() || bytes_.substr(at_, 8) != "FoamFile") return;
  word("FoamFile");
  expect('{', "the file's header");
  while (!accept('}')) {
    const std::string_view key = word("a key of the file's header");
    if (key == "format") {
      const std::string_view format = word("the format");
      if (format != "ascii" && format != "binary") fail("the format is neither ascii nor binary");
      binary_ = format == "binary";
    } else if (key == "arch") {
      read_arch(word("the architecture"));
    }
    skip_entry();
  }
}

// "LSB;label=32;scalar=64"
void FoamScanner::read_arch(std::string_view text) {
  order_ = text.find("MSB") != std::string_view::npos ? std::endian::big : std::endian::little;
  label_bytes_ = text.find("label=64") != std::string_view::npos ? 8 : 4;
  scalar_bytes_ = text.find("scalar=32") != std::string_view::npos ? 4 : 8;
}

double FoamScanner::number(const char* what) {
  if (!next()) fail(std::string("expected a number as ") + what + ", found the end of the file");
  const char* first = bytes_.data() + at_;
  const char* end = bytes_.data() + bytes_.size();
  const char* last = first;
  while (last != end && !is_blank(*last) && !is_punctuation(*last)) ++last;
  double value = 0;
  auto [after, status] = std::from_chars(first + (first != last && *first == '+' ? 1 : 0), last, value);
  if (status == std::errc::result_out_of_range && last - first < 64) {
    value = std::strtod(std::string(first, last).c_str(), nullptr);  // tiny: zero or a denormal; huge: infinite
  } else if (status != std::errc{} || after != last) {
    fail(std::string("expected a number as ") + what + ", found " + quoted());
  }
  if (!std::isfinite(value)) fail(std::string(what) + " " + quoted() + " is not a finite number");
  at_ += static_cast<std::size_t>(last - first);
  return value;
}

std::int64_t FoamScanner::integer(const char* what) {
  const bool there = next();
  std::int64_t value = 0;
  const auto [after, status] = std::from_chars(bytes_.data() + at_, bytes_.data() + bytes_.size(), value);
  const std::size_t end = static_cast<std::size_t>(after - bytes_.data());
  if (!there || status != std::errc{} || (end < bytes_.size() && !is_blank(bytes_[end]) && !is_punctuation(bytes_[end]))) {
    fail(std::string("expected an integer as ") + what + ", found " + quoted());
  }
  at_ = end;
  return value;
}

std::uint32_t FoamScanner::index(const char* what, std::uint64_t limit) {
  next();
  const std::size_t begin = at_;
  const std::int64_t value = integer(what);
  if (value < 0 || static_cast<std::uint64_t>(value) >= limit) {
    fail_at(begin, std::string(what) + " " + std::to_string(value) + " is outside 0.." + std::to_string(limit) + " (exclusive)");
  }
  return static_cast<std::uint32_t>(value);
}

std::size_t FoamScanner::count(const char* what, std::size_t least_bytes) {
  next();
  const std::size_t begin = at_;
  const std::int64_t value = integer(what);
  if (value < 0 || static_cast<std::uint64_t>(value) > left() / least_bytes + 1 || value > 0xffffffffll) {
    fail_at(begin, std::string(what) + " is " + std::to_string(value) + ", the file has only " + std::to_string(left()) +
                       " bytes left for them");
  }
  return static_cast<std::size_t>(value);
}

std::string_view FoamScanner::raw(std::size_t bytes, const char* what) {
  expect('(', what);
  if (bytes > left()) {
    fail(std::string(what) + " needs " + std::to_string(bytes) + " bytes, the file has " + std::to_string(left()) + " left");
  }
  const std::string_view result = bytes_.substr(at_, bytes);
  at_ += bytes;
  expect(')', what);
  return result;
}

std::vector<std::uint32_t> FoamScanner::labels(const char* what, std::uint64_t limit, std::uint64_t most, MinusOne minus_one_is) {
  const bool allowed = minus_one_is == MinusOne::allowed;
  next();
  const std::size_t begin = at_;
  const std::size_t bytes_each = static_cast<std::size_t>(label_bytes_);
  std::vector<std::uint32_t> result;
  if (binary_) {
    const std::size_t size = count(what, bytes_each);
    if (size == 0 && peek() != '(') return result;
    const std::string_view bytes = raw(size * bytes_each, what);
    result.resize(size);
    for (std::size_t i = 0; i < size; ++i) {
      const char* at = bytes.data() + i * bytes_each;
      const std::uint64_t value =
          label_bytes_ == 8 ? load_scalar<std::uint64_t>(at, order_) : load_scalar<std::uint32_t>(at, order_);
      if (allowed && value == (label_bytes_ == 8 ? ~std::uint64_t{0} : std::uint64_t{minus_one})) {
        result[i] = minus_one;
        continue;
      }
      if (value >= limit) {
        fail_at(begin,
                std::string(what) + ": entry " + std::to_string(i) + " is outside 0.." + std::to_string(limit) + " (exclusive)");
      }
      result[i] = static_cast<std::uint32_t>(value);
    }
    return result;
  }
  const std::int64_t size = integer(what);
  if (size < 0 || static_cast<std::uint64_t>(size) > most) {
    fail_at(begin, std::string(what) + ": a list of " + std::to_string(size) + ", at most " + std::to_string(most) + " can be");
  }
  if (accept('{')) {
    result.assign(static_cast<std::size_t>(size), index(what, limit));
    expect('}', what);
    return result;
  }
  move_to(begin);
  result.reserve(count(what, 2));
  expect('(', what);
  while (result.size() < static_cast<std::size_t>(size)) {
    const bool none = allowed && peek() == '-';
    if (none && integer(what) != -1) fail(std::string(what) + ": the only negative number here is -1");
    result.push_back(none ? minus_one : index(what, limit));
  }
  expect(')', what);
  return result;
}

std::vector<std::int64_t> FoamScanner::signed_labels(const char* what) {
  const std::size_t bytes_each = binary_ ? static_cast<std::size_t>(label_bytes_) : 2;
  std::vector<std::int64_t> result(count(what, bytes_each));
  if (result.empty() && peek() != '(') return result;
  if (binary_) {
    const std::string_view bytes = raw(result.size() * bytes_each, what);
    for (std::size_t i = 0; i < result.size(); ++i) {
      const char* at = bytes.data() + i * bytes_each;
      result[i] = label_bytes_ == 8 ? std::bit_cast<std::int64_t>(load_scalar<std::uint64_t>(at, order_))
                                    : std::bit_cast<std::int32_t>(load_scalar<std::uint32_t>(at, order_));
    }
    return result;
  }
  expect('(', what);
  for (std::int64_t& value : result) value = integer(what);
  expect(')', what);
  return result;
}

void FoamScanner::fail_at(std::size_t position, const std::string& message) const {
  const auto end = bytes_.begin() + static_cast<std::ptrdiff_t>(std::min(position, bytes_.size()));
  const auto line = std::count(bytes_.begin(), end, '\n') + 1;
  throw Error(ErrorCode::invalid_argument, name_ + ": line " + std::to_string(line) + ": " + message);
}

std::string FoamScanner::quoted() const {
  constexpr std::size_t longest = 24;
  if (at_ >= bytes_.size()) return "the end of the file";
  std::string text;
  for (std::size_t i = at_; i < bytes_.size() && !is_blank(bytes_[i]) && text.size() < longest; ++i) {
    text += bytes_[i] >= ' ' && bytes_[i] <= '~' ? bytes_[i] : '?';
  }
  return "\"" + text + "\"";
}

}  // namespace deform::io
