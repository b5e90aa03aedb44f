#include "server/service_text.h"

#include "core/base/text.h"

namespace deform::server {

std::string escaped(std::string_view text, std::size_t limit) {
  static constexpr std::string_view ellipsis = "...";
  std::string out;
  std::size_t fits = 0;  // length of the longest prefix of `out` that leaves room for the ellipsis
  while (!text.empty()) {
    const bool backslash = text.front() == '\\';
    const std::string shown = take_printable(text);
    const std::string piece = backslash ? "\\x5c" : shown;
    if (out.size() + piece.size() > limit) return out.substr(0, fits).append(ellipsis.substr(0, limit - fits));
    out += piece;
    if (out.size() + ellipsis.size() <= limit) fits = out.size();
  }
  return out;
}

}  // namespace deform::server
