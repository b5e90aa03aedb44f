// SPDX-License-Identifier: Apache-2.0
#include "core/base/commit/commit.h"
#include "core/base/version.h"

namespace deform {

std::string version_line(const std::string& program) { return program + " " + version() + " (commit " + commit() + ")"; }

}  // namespace deform
