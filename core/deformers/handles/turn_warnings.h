// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/system.h"

namespace deform {

/// Warns of handles that turn, for methods whose energy is that of a shell. Handles with a displacement per point are not
/// checked. Any thread.
void add_turn_warnings(const Setup& setup, const BoundDesign& design, DesignReport& report);

}  // namespace deform
