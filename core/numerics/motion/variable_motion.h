// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <variant>

#include "core/base/types.h"
#include "core/compiled/motion.h"

namespace deform {

/// x' = x + v direction.
struct Translation {
  Vec3 direction{};  ///< not zero; need not be of unit length
};
/// By v radians about the axis through the centre, right-handed.
struct Rotation {
  Vec3 axis{};    ///< not zero; need not be of unit length
  Vec3 centre{};  ///< a point of the axis
};
/// x' = centre + (1 + v)(x - centre); with an axis (not zero) only along it.
struct Scaling {
  Vec3 centre{};  ///< stays where it is
  Vec3 axis{};    ///< zero: in all directions
};

/// How a design variable v moves; 0 is the rest position.
using VariableMotion = std::variant<Translation, Rotation, Scaling>;

/// The same as compiled deformations have it, whose maps these are.
compiled::VariableMotion compiled_motion(const VariableMotion& motion);

/// The map of positions at v; the identity exactly at 0.
Affine motion_at(const VariableMotion& motion, double v);
/// Its derivative with respect to v: maps positions at rest to rates.
Affine motion_rate(const VariableMotion& motion, double v);

}  // namespace deform
