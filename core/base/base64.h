// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace deform {

/// Characters that hold so many bytes, padding included.
constexpr std::size_t base64_size(std::size_t bytes) { return (bytes + 2) / 3 * 4; }

/// RFC 4648 with padding, no line ends.
std::string base64_encoded(std::string_view bytes);
/// Nothing when it is no such text.
std::optional<std::string> base64_decoded(std::string_view text);

}  // namespace deform
