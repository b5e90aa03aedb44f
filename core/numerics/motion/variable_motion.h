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
/// Unit of an angle.
enum class AngleUnit { radians, degrees };
/// Right-handed rotation by the angle v about the axis through the centre.
struct Rotation {
  Vec3 axis{};                          ///< not zero; need not be of unit length
  Vec3 centre{};                        ///< a point of the axis
  AngleUnit unit = AngleUnit::radians;  ///< of v
};
/// x' = centre + (1 + v)(x - centre), or only along the axis if it is not zero.
struct Scaling {
  Vec3 centre{};  ///< fixed point
  Vec3 axis{};    ///< zero: scales in all directions
};

/// The motion that a design variable v prescribes; v = 0 is the rest position.
using VariableMotion = std::variant<Translation, Rotation, Scaling>;

/// The same motion for compiled deformations, whose maps are used here.
compiled::VariableMotion compiled_motion(const VariableMotion& motion);

/// The map of positions at v, exactly the identity at v = 0.
Affine motion_at(const VariableMotion& motion, double v);
/// The derivative of motion_at() with respect to v; maps rest positions to their rates.
Affine motion_rate(const VariableMotion& motion, double v);

}  // namespace deform
