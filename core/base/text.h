// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace deform {

/// Length in bytes of the UTF-8 sequence at the front of `text`, which must not be empty; 0 if the sequence is invalid (RFC
/// 3629), as overlong forms, surrogates and code points beyond U+10FFFF are.
std::size_t utf8_length(std::string_view text);

/// Removes the first character from `text`, which must not be empty, and returns it in a form that is safe to show in a terminal
/// or a log. Characters that control a terminal (C0, DEL, C1), end a line (U+2028, U+2029) or change the direction of text
/// (U+061C, U+200E, U+200F, U+202A to U+202E, U+2066 to U+2069) are escaped as `\xNN` or `\u{NNNN}`, bytes that are not valid
/// UTF-8 as `\xNN`; all others are returned unchanged.
std::string take_printable(std::string_view& text);

/// Applies take_printable() to the whole text. The ASCII characters in `kept`, such as "\n\t", are not escaped.
std::string printable(std::string_view text, std::string_view kept = {});

/// Turns arbitrary bytes into text for a log line, a status message or a proto3 string: escapes backslashes and what printable()
/// escapes. The result has at most `limit` bytes; longer text is cut between characters and ends in "...".
std::string escaped(std::string_view text, std::size_t limit);

/// Converts ASCII letters to lower or upper case and leaves other bytes unchanged.
std::string lower_case(std::string_view text);
std::string upper_case(std::string_view text);

/// Escapes text for the body or a quoted attribute of HTML or XML: & < > " ' become entities, control characters blanks, and
/// bytes that are not valid UTF-8 become U+FFFD.
std::string markup_text(std::string_view text);

}  // namespace deform
