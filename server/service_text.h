#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace deform::server {

/// Text that may stand in a log line, a status message or a proto3 string, whatever bytes came in: valid UTF-8 is kept; what
/// printable() escapes, and backslashes, are escaped. At most `limit` bytes, cut between characters and then
/// ended by "...". Any thread.
std::string escaped(std::string_view text, std::size_t limit);

}  // namespace deform::server
