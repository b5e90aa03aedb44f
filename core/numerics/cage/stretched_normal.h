// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>

#include "core/base/types.h"

namespace deform {

/// The normal of a moved triangle times its stretch (Lipman, Levin, Cohen-Or 2008, section 4): with two sides u and v of the
/// triangle at rest, u' and v' of the moved one, and the area A at rest,
///   s = sqrt(|u'|^2 |v|^2 - 2 (u' . v') (u . v) + |v'|^2 |u|^2) / (sqrt(8) A),
/// the root mean square of the two principal stretches of the triangle. The vector s n' is that of the point in Green
/// coordinates; where the triangle is turned, moved and scaled, it is the turned normal times the scale.
///
/// Immutable; any thread.
class StretchedNormal {
 public:
  using Corners = std::array<Vec3, 3>;

  /// The corners at rest, which must not lie on a line.
  explicit StretchedNormal(const Corners& rest);

  /// Whether the moved corners have a normal: they do not lie on a line, up to rounding.
  bool exists(const Corners& moved) const;
  /// s n' - n, no unit. The normal of the moved corners must exist here and below.
  Vec3 change(const Corners& moved) const;
  /// The derivative of s n' when the corners move at these rates.
  Vec3 rate(const Corners& moved, const Corners& rates) const;
  /// The transpose: the derivative of the product of s n' and `cotangent` with respect to the corners.
  Corners gradient(const Corners& moved, const Vec3& cotangent) const;

 private:
  /// The two sides and what follows from them.
  struct Moved;
  Moved moved_sides(const Corners& moved) const;

  Vec3 normal_{};
  double u2_ = 0, uv_ = 0, v2_ = 0;  ///< products of the sides at rest
  double doubled_ = 0;               ///< 8 A^2
};

}  // namespace deform
