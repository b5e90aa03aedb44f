// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <vector>

#include "core/constraints/detection/growth.h"

namespace deform::detection {

/// Lines, circles and arcs among the feature edges: those that are sharper than the maximum angle, those between two primitives
/// that do not run into each other smoothly, and rims. Chains of them end where they branch or where the primitives beside them
/// change; a chain that is no line, circle or arc as a whole is cut into the longest pieces that are. Pieces, and chains that are
/// not between primitives or at their rims, need five points and must be longer than smooth curves are straight by chance; arcs
/// that are not need eight, lines as whole chains only three. Sorted.
std::vector<EdgeFeature> feature_edges(const Mesh& mesh, const Surface& surface, const Limits& limits,
                                       std::span<const std::uint32_t> labels);

}  // namespace deform::detection
