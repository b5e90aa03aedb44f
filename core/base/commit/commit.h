// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace deform {

/// The commit that was built, with "-dirty" when files of it were changed; "unknown" when the sources are no clone.
const char* commit();

/// What a program answers to --version: "NAME VERSION (commit COMMIT)".
std::string version_line(const std::string& program);

}  // namespace deform
