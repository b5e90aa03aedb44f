// SPDX-License-Identifier: Apache-2.0
#include "core/base/version.h"

namespace deform {

const char* version() { return DEFORM_VERSION; }

}  // namespace deform
