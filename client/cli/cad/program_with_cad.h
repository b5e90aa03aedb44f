// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "client/cli/commands/command.h"

namespace deform::cli {

/// For commands that need OpenCASCADE, before they do anything. Where this program was built without, the process becomes the
/// program "deform-cad" in the same folder, with the same arguments. Throws Error(failed_precondition) where that cannot be
/// started; where it does not exist, the message says what brings it.
void need_cad(const CommonOptions& common);

}  // namespace deform::cli
