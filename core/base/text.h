// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace deform {

/// Length in bytes of the UTF-8 sequence at the front of `text` (not empty), 0 when there is none: overlong forms, surrogates and
/// what is beyond U+10FFFF are none (RFC 3629).
std::size_t utf8_length(std::string_view text);

/// Takes the first character from `text` (not empty) and returns it as a terminal or a log may show it: itself, or as `\xNN` or
/// `\u{NNNN}` what controls a terminal (C0, DEL, C1), ends a line (U+2028, U+2029) or changes the direction of text (U+061C,
/// U+200E, U+200F, U+202A to U+202E, U+2066 to U+2069); a byte that is no UTF-8 as `\xNN`.
std::string take_printable(std::string_view& text);

/// All of it; the characters of `kept` (ASCII) stay what they are, as "\n\t" in text of our own.
std::string printable(std::string_view text, std::string_view kept = {});

/// Text that may stand in a log line, a status message or a proto3 string, whatever bytes came in: valid UTF-8 is kept; what
/// printable() escapes, and backslashes, are escaped. At most `limit` bytes, cut between characters and then
/// ended by "...". Any thread.
std::string escaped(std::string_view text, std::size_t limit);

/// ASCII letters in lower case or in capitals, everything else as it is.
std::string lower_case(std::string_view text);
std::string upper_case(std::string_view text);

/// Text for the body or a quoted attribute of HTML or XML: & < > " ' as entities, control characters as blanks; bytes that are no
/// UTF-8 as U+FFFD.
std::string markup_text(std::string_view text);

}  // namespace deform
