// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdlib>

namespace deform::test {

/// Whether tests may take long, as every night: DEFORM_LONG is set. They try many more cases then.
inline bool long_tests() { return std::getenv("DEFORM_LONG") != nullptr; }

}  // namespace deform::test
