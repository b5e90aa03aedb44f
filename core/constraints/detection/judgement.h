// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>

#include "core/constraints/detection/growth.h"

namespace deform::detection {

/// The simplest kind that describes the faces of the region as well as the best does, refitted: a cone or sphere also fits two
/// circles of a coarse cylinder, and anything of large radius fits a plane. Directions decide between kinds whose distances are
/// alike. The region itself when no kind is better.
Region simplest(const Surface& surface, const Limits& limits, const Region& region);

/// Whether the region is evidence for its shape: enough different directions for a curved one, enough points for a plane, and
/// residuals that look like noise. Residuals that polynomials of degree 3 over the region explain belong to another shape: those
/// of a torus, or of a free form, taken for a cylinder.
bool convincing(const Surface& surface, const Limits& limits, const Region& region);

/// Whether a curved region, whole by now, is curved enough for it: how far its points rise above a flat piece (the sagitta) must
/// be large against their distances from the shape, and what turns by less than 30 degrees must leave nothing but noise behind.
/// Any free-form panel is nearly a cylinder of large radius over a few degrees. True for planes.
bool evident(const Surface& surface, const Region& region);

/// The last part of convincing(), from fewer points; true for faces with few points.
bool noisy(const Surface& surface, const Limits& limits, const Shape& shape, std::span<const FaceId> faces);

}  // namespace deform::detection
