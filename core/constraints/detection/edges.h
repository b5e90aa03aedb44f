// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>
#include <vector>

#include "core/constraints/detection/growth.h"

namespace deform::detection {

/// Finds lines, circles and arcs among the feature edges: edges sharper than the maximum angle, edges between two primitives that
/// do not join smoothly, and boundary edges. Chains of feature edges end where they branch or where the adjacent primitives
/// change. A chain that is not a line, circle or arc as a whole is cut into the longest pieces that are. Pieces, and chains that
/// neither separate primitives nor bound one, need five points (arcs eight) and must be longer than a smooth curve looks straight
/// by chance; lines that are whole chains need only three points. The result is sorted.
std::vector<EdgeFeature> feature_edges(const Mesh& mesh, const Surface& surface, const Limits& limits,
                                       std::span<const std::uint32_t> labels);

}  // namespace deform::detection
