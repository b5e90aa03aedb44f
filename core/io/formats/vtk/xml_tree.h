// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace deform::io {

/// An element of an XML file with its positions, so that text can be replaced there.
struct XmlNode {
  struct Attribute {
    std::string_view name;
    std::size_t begin, end;  ///< byte offsets of the value between the quotes
  };
  std::string_view name;
  std::size_t place = 0;                       ///< byte offset of its start tag
  std::size_t text_begin = 0, text_end = 0;    ///< its first nonblank text, trimmed; may be empty
  std::size_t inner_begin = 0, inner_end = 0;  ///< content between its tags
  std::vector<Attribute> attributes;
  std::vector<XmlNode> children;

  const Attribute* find(std::string_view attribute) const;
  const XmlNode* child(std::string_view child_name) const;
};

/// Reads elements, attributes, text, comments and declarations; no name spaces, no custom entities. The content of an element
/// called `opaque` is not parsed; it extends to the last end tag of that name. Throws Error(invalid_argument) with the line. The
/// bytes must outlive the tree.
XmlNode parse_xml(std::string_view bytes, const std::string& name, std::string_view opaque);

/// Replaces &lt; &gt; &amp; &quot; and &apos; in a value.
std::string xml_text(std::string_view value);

/// Throws Error(invalid_argument) "NAME: line L: MESSAGE", where L is the line of this byte.
[[noreturn]] void fail_in_line(std::string_view bytes, const std::string& name, std::size_t position, const std::string& message);

}  // namespace deform::io
