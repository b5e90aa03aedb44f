// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/ply/ply_header.h"

#include <algorithm>
#include <charconv>
#include <utility>

#include "core/base/error.h"

namespace deform::io {

namespace {

constexpr std::pair<const char*, PlyType> type_names[] = {
    {"char", PlyType::int8},     {"int8", PlyType::int8},       {"uchar", PlyType::uint8},    {"uint8", PlyType::uint8},
    {"short", PlyType::int16},   {"int16", PlyType::int16},     {"ushort", PlyType::uint16},  {"uint16", PlyType::uint16},
    {"int", PlyType::int32},     {"int32", PlyType::int32},     {"uint", PlyType::uint32},    {"uint32", PlyType::uint32},
    {"float", PlyType::float32}, {"float32", PlyType::float32}, {"double", PlyType::float64}, {"float64", PlyType::float64},
};

constexpr std::size_t max_header_items = 1000;  // elements, and properties of each

class HeaderReader {
 public:
  HeaderReader(std::string_view bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  PlyHeader read() {
    next_line();
    if (words_.size() != 1 || words_[0] != "ply") fail("expected \"ply\" as the first line, found " + found());
    next_line();
    read_format();
    for (next_line(); words_[0] != "end_header"; next_line()) {
      if (words_[0] == "element") {
        read_element();
      } else if (words_[0] == "property") {
        read_property();
      } else if (words_[0] != "comment" && words_[0] != "obj_info") {
        fail("expected comment, element, property or end_header, found " + found());
      }
    }
    header_.end = at_;
    return std::move(header_);
  }

 private:
  [[noreturn]] void fail(const std::string& message) const {
    throw Error(ErrorCode::invalid_argument, name_ + ": line " + std::to_string(line_) + ": " + message);
  }

  std::string found() const {
    constexpr std::size_t longest = 40;
    std::string text("\"");
    for (const std::string_view word : words_) {
      if (text.size() > 1) text += ' ';
      text += word.substr(0, longest);
    }
    text.resize(std::min(text.size(), longest));
    for (char& c : text) c = c >= ' ' && c <= '~' ? c : '?';
    text += '"';
    return text;
  }

  /// Words of the next line that has any. Lines end with LF, CR LF or CR.
  void next_line() {
    words_.clear();
    while (words_.empty()) {
      ++line_;
      if (at_ == bytes_.size()) fail("expected the header to go on to end_header, found the end of the file");
      std::size_t end = bytes_.find_first_of("\r\n", at_);
      if (end == std::string_view::npos) end = bytes_.size();
      split(bytes_.substr(at_, end - at_));
      at_ = end;
      if (at_ < bytes_.size() && bytes_[at_] == '\r') ++at_;
      if (at_ < bytes_.size() && bytes_[at_] == '\n' && (at_ == end || bytes_[at_ - 1] == '\r')) ++at_;
    }
  }

  void split(std::string_view line) {
    constexpr std::size_t max_words = 8;  // a comment needs none, everything else at most five
    std::size_t at = 0;
    while (words_.size() < max_words) {
      at = line.find_first_not_of(" \t", at);
      if (at == std::string_view::npos) return;
      const std::size_t end = std::min(line.find_first_of(" \t", at), line.size());
      words_.push_back(line.substr(at, end - at));
      at = end;
    }
  }

  void read_format() {
    if (words_.size() != 3 || words_[0] != "format") fail("expected \"format ascii 1.0\" or another format, found " + found());
    if (words_[1] == "binary_little_endian" || words_[1] == "binary_big_endian") {
      header_.binary = true;
      header_.order = words_[1] == "binary_big_endian" ? std::endian::big : std::endian::little;
    } else if (words_[1] != "ascii") {
      fail("expected the format ascii, binary_little_endian or binary_big_endian, found " + found());
    }
    if (words_[2] != "1.0") fail("expected version 1.0, found " + found());
  }

  void read_element() {
    if (words_.size() != 3) fail("expected \"element NAME COUNT\", found " + found());
    PlyElement element;
    element.name = words_[1];
    element.line = line_;
    const auto [end, status] = std::from_chars(words_[2].data(), words_[2].data() + words_[2].size(), element.count);
    if (status != std::errc{} || end != words_[2].data() + words_[2].size()) {
      fail("expected the count of element " + element.name + ", found \"" + std::string(words_[2].substr(0, 24)) + "\"");
    }
    for (const PlyElement& other : header_.elements) {
      if (other.name == element.name) fail("element " + element.name + " is declared twice");
    }
    if (header_.elements.size() == max_header_items) fail("more than " + std::to_string(max_header_items) + " elements");
    header_.elements.push_back(std::move(element));
  }

  void read_property() {
    if (header_.elements.empty()) fail("expected an element before its properties, found " + found());
    PlyElement& element = header_.elements.back();
    PlyProperty property;
    if (words_.size() == 5 && words_[1] == "list") {
      property.counted = read_type(words_[2]);
      if (!is_integer(*property.counted)) fail("the length of list " + std::string(words_[4]) + " must be of an integer type");
      property.type = read_type(words_[3]);
      property.name = words_[4];
    } else if (words_.size() == 3) {
      property.type = read_type(words_[1]);
      property.name = words_[2];
    } else {
      fail("expected \"property TYPE NAME\" or \"property list TYPE TYPE NAME\", found " + found());
    }
    if (element.find(property.name) >= 0)
      fail("property " + property.name + " of element " + element.name + " is declared twice");
    if (element.properties.size() == max_header_items) fail("more than " + std::to_string(max_header_items) + " properties");
    element.properties.push_back(std::move(property));
  }

  PlyType read_type(std::string_view word) const {
    for (const auto& [type_name, type] : type_names) {
      if (word == type_name) return type;
    }
    fail("unknown property type in " + found() + "; types are char, uchar, short, ushort, int, uint, float, double");
  }

  const std::string_view bytes_;
  const std::string& name_;
  std::size_t at_ = 0, line_ = 0;
  std::vector<std::string_view> words_;
  PlyHeader header_;
};

}  // namespace

std::size_t size_of(PlyType type) {
  switch (type) {
    case PlyType::int8:
    case PlyType::uint8:
      return 1;
    case PlyType::int16:
    case PlyType::uint16:
      return 2;
    case PlyType::int32:
    case PlyType::uint32:
    case PlyType::float32:
      return 4;
    case PlyType::float64:
      return 8;
  }
  return 0;
}

bool is_integer(PlyType type) { return type != PlyType::float32 && type != PlyType::float64; }

const char* to_string(PlyType type) {
  for (const auto& [type_name, known] : type_names) {
    if (known == type) return type_name;
  }
  return "unknown";
}

int PlyElement::find(std::string_view property) const {
  for (std::size_t i = 0; i < properties.size(); ++i) {
    if (properties[i].name == property) return static_cast<int>(i);
  }
  return -1;
}

bool PlyElement::fixed_size() const {
  return std::none_of(properties.begin(), properties.end(), [](const PlyProperty& p) { return p.counted.has_value(); });
}

std::uint64_t PlyElement::smallest_bytes() const {
  std::uint64_t bytes = 0;
  for (const PlyProperty& property : properties) bytes += size_of(property.counted.value_or(property.type));
  return bytes;
}

PlyHeader read_ply_header(std::string_view bytes, const std::string& name) { return HeaderReader(bytes, name).read(); }

}  // namespace deform::io
