// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace deform {

/// The version of this build: MAJOR.MINOR.PATCH.
const char* version();

}  // namespace deform
