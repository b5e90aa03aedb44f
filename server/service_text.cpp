#include "server/service_text.h"

#include <cstdint>

namespace deform::server {

namespace {

/// Length of the UTF-8 character at the start of `text`, 0 when there is none (RFC 3629: no overlong forms, no surrogates).
std::size_t utf8_length(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<std::uint8_t>(text[i]); };
  const std::uint8_t lead = byte(0);
  if (lead < 0x80) return 1;
  const std::size_t length = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : 2;
  if (lead < 0xC2 || lead > 0xF4 || text.size() < length) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return 0;
  }
  if (lead == 0xE0 && byte(1) < 0xA0) return 0;
  if (lead == 0xED && byte(1) > 0x9F) return 0;
  if (lead == 0xF0 && byte(1) < 0x90) return 0;
  if (lead == 0xF4 && byte(1) > 0x8F) return 0;
  return length;
}

std::string hexadecimal(char c) {
  static constexpr char digits[] = "0123456789abcdef";
  const auto byte = static_cast<std::uint8_t>(c);
  return {'\\', 'x', digits[byte >> 4], digits[byte & 15]};
}

}  // namespace

std::string escaped(std::string_view text, std::size_t limit) {
  static constexpr std::string_view ellipsis = "...";
  std::string out;
  std::size_t fits = 0;  // length of the longest prefix of `out` that leaves room for the ellipsis
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    const bool control = length == 1 && (static_cast<std::uint8_t>(text[0]) < 0x20 || text[0] == 0x7F);
    const std::string piece =
        length == 0 || control || text[0] == '\\' ? hexadecimal(text[0]) : std::string(text.substr(0, length));
    if (out.size() + piece.size() > limit) return out.substr(0, fits).append(ellipsis.substr(0, limit - fits));
    out += piece;
    if (out.size() + ellipsis.size() <= limit) fits = out.size();
    text.remove_prefix(length == 0 ? 1 : length);
  }
  return out;
}

}  // namespace deform::server
