// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace deform::io {

/// An element of an XML file by places in it, so that text can be replaced there.
struct XmlNode {
  struct Attribute {
    std::string_view name;
    std::size_t begin, end;  ///< byte offsets of the value as it stands between the quotes
  };
  std::string_view name;
  std::size_t place = 0;                       ///< byte offset of its <
  std::size_t text_begin = 0, text_end = 0;    ///< its first text that is not blank, without the blanks around it; may be empty
  std::size_t inner_begin = 0, inner_end = 0;  ///< between its tags
  std::vector<Attribute> attributes;
  std::vector<XmlNode> children;

  const Attribute* find(std::string_view attribute) const;
  const XmlNode* child(std::string_view child_name) const;
};

/// Reads elements, attributes, text, comments and declarations; no name spaces, no own entities. The inside of an element
/// called `opaque` is not looked at: it reaches to the last end tag of that name. Throws Error(invalid_argument) with the line.
/// The bytes must outlive the tree.
XmlNode parse_xml(std::string_view bytes, const std::string& name, std::string_view opaque);

/// The value with &lt; &gt; &amp; &quot; and &apos; replaced.
std::string xml_text(std::string_view value);

/// "NAME: line L: MESSAGE", L being the line of that byte.
[[noreturn]] void fail_in_line(std::string_view bytes, const std::string& name, std::size_t position, const std::string& message);

}  // namespace deform::io
