// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/io/mesh_file.h"

namespace deform::cli {

/// How the commands read mesh files: those that may crash a library in a process of this program of their own.
io::ReadOptions own_process();
/// The same; `cancel` ends it.
io::ReadOptions own_process(const CancelFlag& cancel);

}  // namespace deform::cli
