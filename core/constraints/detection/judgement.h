// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>

#include "core/constraints/detection/growth.h"

namespace deform::detection {

/// Refits the region with the simplest kind that describes its faces as well as the best one: a cone or sphere also fits two
/// circles of a coarse cylinder, and any shape of large radius fits a plane. Normals decide between kinds with similar distances.
/// Returns the region unchanged if no kind is better.
Region simplest(const Surface& surface, const Limits& limits, const Region& region);

/// Whether the region is sufficient evidence for its shape: enough distinct normals for a curved shape, enough points for a
/// plane, and residuals that look like noise. Residuals that cubic polynomials over the region explain indicate another shape,
/// such as a torus or a free form taken for a cylinder.
bool convincing(const Surface& surface, const Limits& limits, const Region& region);

/// Whether a complete curved region is curved enough to be evidence for its shape: its sagitta must be large compared with the
/// distances of its points from the shape, and regions that turn by less than 30 degrees must have residuals of pure noise. (Over
/// a few degrees any free-form panel is close to a cylinder of large radius.) True for planes.
bool evident(const Surface& surface, const Region& region);

/// The noise test of convincing() with fewer points; true if there are few points.
bool noisy(const Surface& surface, const Limits& limits, const Shape& shape, std::span<const FaceId> faces);

}  // namespace deform::detection
