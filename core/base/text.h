#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace deform {

/// Length in bytes of the UTF-8 sequence at the front of `text` (not empty), 0 when there is none: overlong forms, surrogates and
/// what is beyond U+10FFFF are none (RFC 3629).
std::size_t utf8_length(std::string_view text);

/// Text for the body or a quoted attribute of HTML or XML: & < > " ' as entities, control characters as blanks; bytes that are no
/// UTF-8 as U+FFFD.
std::string markup_text(std::string_view text);

}  // namespace deform
