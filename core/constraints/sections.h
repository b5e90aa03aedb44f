// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "core/constraints/projection.h"

namespace deform {

/// The points of a cross-section, as positions in a set.
using Section = std::vector<std::uint32_t>;

/// A projection onto a shape of revolution, of which circles can be cross-sections.
class WithSections {
 public:
  virtual ~WithSections() = default;
  /// The same shape with the additional condition that the points of each section lie in one plane perpendicular to the axis.
  /// Sections are disjoint. Five or more points that lie on a circle and on the shape satisfy the condition already; but the
  /// linearization here expresses it to first order, which distances from circle and shape do not. The shape parameters are those
  /// of the shape alone. A `curvature` is that of sections that keep their radius; the shape takes it.
  virtual std::unique_ptr<const Projection> with_sections(std::vector<Section> sections,
                                                          std::optional<double> curvature) const = 0;
  /// The curvature that the shape keeps, if any.
  virtual std::optional<double> kept_curvature() const = 0;
};

/// A projection onto a circle, which may be a section.
class IsSection {
 public:
  virtual ~IsSection() = default;
  /// The curvature that the circle keeps, if any.
  virtual std::optional<double> kept_curvature() const = 0;
};

}  // namespace deform
