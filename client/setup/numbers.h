// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string_view>

namespace deform::client {

/// A finite decimal number that fills the whole text, blanks around it and a leading plus allowed; nothing for anything else.
/// Independent of the locale.
std::optional<double> parse_number(std::string_view text);

}  // namespace deform::client
