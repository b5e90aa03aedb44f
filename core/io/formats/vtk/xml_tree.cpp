// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/vtk/xml_tree.h"

#include <algorithm>

#include "core/base/error.h"

namespace deform::io {

namespace {

constexpr std::size_t deepest = 64;

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; }

class XmlParser {
 public:
  XmlParser(std::string_view bytes, const std::string& name, std::string_view opaque)
      : bytes_(bytes), name_(name), opaque_(opaque) {}

  XmlNode read() {
    if (bytes_.starts_with("\xef\xbb\xbf")) at_ = 3;
    skip_prolog();
    if (peek() != '<') fail("expected XML, which begins with <");
    XmlNode root = element(0);
    skip_prolog();
    if (at_ != bytes_.size()) fail("expected the end of the file behind the outermost element");
    return root;
  }

 private:
  [[noreturn]] void fail(const std::string& message) const { fail_in_line(bytes_, name_, at_, message); }
  char peek() const { return at_ < bytes_.size() ? bytes_[at_] : '\0'; }
  bool ahead(std::string_view text) const { return bytes_.substr(at_, text.size()) == text; }
  void skip_blanks() {
    while (at_ < bytes_.size() && is_blank(bytes_[at_])) ++at_;
  }

  void skip_past(std::string_view end) {
    const std::size_t found = bytes_.find(end, at_);
    if (found == std::string_view::npos) fail("expected " + std::string(end) + " before the end of the file");
    at_ = found + end.size();
  }

  /// Over a comment, a processing instruction or a document type, if there is one.
  bool skip_aside() {
    if (ahead("<!--")) {
      skip_past("-->");
    } else if (ahead("<?")) {
      skip_past("?>");
    } else if (ahead("<!DOCTYPE")) {
      skip_past(">");
    } else {
      return false;
    }
    return true;
  }

  void skip_prolog() {
    do {
      skip_blanks();
    } while (skip_aside());
  }

  std::string_view word(const char* what) {
    const std::size_t first = at_;
    const auto ends = [](char c) { return is_blank(c) || c == '>' || c == '/' || c == '=' || c == '<' || c == '"' || c == '\''; };
    while (at_ < bytes_.size() && !ends(bytes_[at_])) ++at_;
    if (at_ == first) fail(std::string("expected ") + what);
    return bytes_.substr(first, at_ - first);
  }

  void read_attribute(XmlNode& node) {
    const std::string_view key = word("the name of an attribute");
    skip_blanks();
    if (peek() != '=') fail("expected = behind the attribute \"" + std::string(key.substr(0, 24)) + "\"");
    ++at_;
    skip_blanks();
    const char quote = peek();
    if (quote != '"' && quote != '\'') fail("expected the value of an attribute in quotes");
    const std::size_t begin = ++at_;
    at_ = bytes_.find(quote, begin);
    if (at_ == std::string_view::npos) {
      at_ = begin;
      fail("a value without its closing quote");
    }
    if (node.find(key) != nullptr) fail("the attribute \"" + std::string(key.substr(0, 24)) + "\" stands there twice");
    node.attributes.push_back({key, begin, at_});
    ++at_;
  }

  XmlNode element(std::size_t depth) {
    if (depth > deepest) fail("elements are nested more than " + std::to_string(deepest) + " deep");
    XmlNode node;
    node.place = at_++;
    node.name = word("the name of an element");
    for (;;) {
      skip_blanks();
      if (ahead("/>")) {
        at_ += 2;
        node.text_begin = node.text_end = node.inner_begin = node.inner_end = at_;
        return node;
      }
      if (peek() == '>') break;
      read_attribute(node);
    }
    node.text_begin = node.text_end = node.inner_begin = ++at_;
    read_inside(node, depth);
    return node;
  }

  void read_inside(XmlNode& node, std::size_t depth) {
    if (node.name == opaque_) {
      const std::size_t end = bytes_.rfind(std::string("</").append(opaque_));
      if (end == std::string_view::npos || end < at_) fail("<" + std::string(opaque_) + "> is not closed");
      at_ = end;
    }
    while (!ahead("</")) {
      if (at_ == bytes_.size())
        fail_in_line(bytes_, name_, node.place, "<" + std::string(node.name.substr(0, 24)) + "> is not closed");
      if (peek() != '<') {
        read_text(node);
      } else if (ahead("<![CDATA[")) {
        fail("CDATA sections are not supported");
      } else if (!skip_aside()) {
        node.children.push_back(element(depth + 1));
      }
    }
    node.inner_end = at_;
    at_ += 2;
    if (word("the name of an element") != node.name) fail("expected </" + std::string(node.name.substr(0, 24)) + ">");
    skip_blanks();
    if (peek() != '>') fail("expected > at the end of a tag");
    ++at_;
  }

  void read_text(XmlNode& node) {
    std::size_t first = at_;
    at_ = std::min(bytes_.find('<', at_), bytes_.size());
    std::size_t last = at_;
    while (first < last && is_blank(bytes_[first])) ++first;
    while (first < last && is_blank(bytes_[last - 1])) --last;
    if (node.text_begin != node.text_end || first == last) return;
    node.text_begin = first;
    node.text_end = last;
  }

  const std::string_view bytes_;
  const std::string& name_;
  const std::string_view opaque_;
  std::size_t at_ = 0;
};

}  // namespace

const XmlNode::Attribute* XmlNode::find(std::string_view attribute) const {
  for (const Attribute& candidate : attributes) {
    if (candidate.name == attribute) return &candidate;
  }
  return nullptr;
}

const XmlNode* XmlNode::child(std::string_view child_name) const {
  for (const XmlNode& candidate : children) {
    if (candidate.name == child_name) return &candidate;
  }
  return nullptr;
}

XmlNode parse_xml(std::string_view bytes, const std::string& name, std::string_view opaque) {
  return XmlParser(bytes, name, opaque).read();
}

std::string xml_text(std::string_view value) {
  static constexpr std::pair<std::string_view, char> entities[] = {
      {"&lt;", '<'}, {"&gt;", '>'}, {"&amp;", '&'}, {"&quot;", '"'}, {"&apos;", '\''}};
  std::string text;
  while (!value.empty()) {
    std::size_t length = 1;
    char c = value[0];
    for (const auto& [entity, meaning] : entities) {
      if (!value.starts_with(entity)) continue;
      length = entity.size();
      c = meaning;
    }
    text += c;
    value.remove_prefix(length);
  }
  return text;
}

void fail_in_line(std::string_view bytes, const std::string& name, std::size_t position, const std::string& message) {
  const auto line = std::count(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(position), '\n') + 1;
  throw Error(ErrorCode::invalid_argument, name + ": line " + std::to_string(line) + ": " + message);
}

}  // namespace deform::io
