// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <variant>

#include "core/base/types.h"

namespace deform {

/// x' = x + v direction.
struct Translation {
  Vec3 direction{};  ///< not zero; need not be of unit length
};
/// What angles are given in.
enum class AngleUnit { radians, degrees };
/// By the angle v about the axis through the centre, right-handed.
struct Rotation {
  Vec3 axis{};                          ///< not zero; need not be of unit length
  Vec3 centre{};                        ///< a point of the axis
  AngleUnit unit = AngleUnit::radians;  ///< of v
};
/// x' = centre + (1 + v)(x - centre); with an axis (not zero) only along it.
struct Scaling {
  Vec3 centre{};  ///< stays where it is
  Vec3 axis{};    ///< zero: in all directions
};

/// How a design variable v moves; 0 is the rest position.
using VariableMotion = std::variant<Translation, Rotation, Scaling>;

/// The map of positions at v; the identity exactly at 0.
Affine motion_at(const VariableMotion& motion, double v);
/// Its derivative with respect to v: maps positions at rest to rates.
Affine motion_rate(const VariableMotion& motion, double v);

}  // namespace deform
