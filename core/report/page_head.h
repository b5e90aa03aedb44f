// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace deform::quality {

/// The beginning of a page up to <body>, with the style of all pages. The title is escaped; `allowed` is what its content
/// security policy permits beside styles in the page: "script-src 'unsafe-inline'".
std::string page_head(const std::string& title, const std::string& allowed);

}  // namespace deform::quality
