// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace deform {

/// Length in characters of the encoding of `bytes` bytes, padding included.
constexpr std::size_t base64_size(std::size_t bytes) { return (bytes + 2) / 3 * 4; }

/// Encodes bytes as Base64 (RFC 4648, section 4) with padding and without line ends.
std::string base64_encoded(std::string_view bytes);
/// The inverse; std::nullopt if `text` is not padded Base64.
std::optional<std::string> base64_decoded(std::string_view text);

}  // namespace deform
