// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/system.h"

namespace deform {

/// How a linear method treats turns.
enum class Turns {
  followed,   ///< where all handles turn alike, all points turn with them
  of_shell,   ///< a turn has energy, because that of a shell measures changes of curvature by displacements
  stretched,  ///< a turn has energy, because stretching measures all first derivatives of displacements, which matters
};

/// How a linear method treats motions that all handles share.
struct SharedMotions {
  Turns turns = Turns::followed;
  /// Whether its functions do not contain 1, x, y and z, so that not even a translation of all handles is followed.
  bool missed = false;
};

/// Warns of designs whose handles move where shared motions are missed, and of handles that turn by more than 15 degrees where
/// turns are not followed. The turn of a handle with a displacement per point is that of the rotation that fits its points best
/// (Kabsch 1976), as far as they determine it: not about the line on which they lie. Any thread.
void add_motion_warnings(const HeldPoints& held, const SharedMotions& motions, const BoundDesign& design, DesignReport& report);

}  // namespace deform
