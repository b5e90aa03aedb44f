// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/constraints/projection.h"

namespace deform {

/// Points of a set, by their places in it.
using Section = std::vector<std::uint32_t>;

/// A projection on a shape about an axis, on which circles are cross-sections.
class WithSections {
 public:
  virtual ~WithSections() = default;
  /// The same shape with the points of each section in one plane across its axis, wherever that is; sections have no point in
  /// common. On such a shape they are circles, which five points or more on a circle and on the shape are in no other way; but
  /// that the planes are square to the axis is said to first order here, which distances from circles and from the shape do not.
  /// The shape parameters are those of the shape alone.
  virtual std::unique_ptr<const Projection> with_sections(std::vector<Section> sections) const = 0;
};

/// A projection on a circle of any radius, which may be a section.
class IsSection {
 public:
  virtual ~IsSection() = default;
};

}  // namespace deform
