// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/base/run_context.h"
#include "core/constraints/detection/growth.h"

namespace deform::detection {

/// Regions, and for each face the index of its region or `unlabelled`.
struct Segmentation {
  std::vector<Region> regions;
  std::vector<std::uint32_t> labels;
};

/// Moves each face at the boundary of a region to the neighbouring region that fits it best in distance and direction, and refits
/// the regions, until nothing changes or for a few sweeps. Then removes disconnected pieces and regions that became too small.
void compete(const Surface& surface, const Limits& limits, Segmentation& segmentation, const RunContext& context);

/// Removes faces that joined a region tangentially at its boundary: those whose error is larger than that of the others in the
/// region both in distance and in direction.
void trim(const Surface& surface, const Limits& limits, Segmentation& segmentation, const RunContext& context);

/// Removes complete curved regions that are not evident().
void drop_accidental(const Surface& surface, Segmentation& segmentation);

/// Joins regions of one surface (see Primitive).
void join_regions(const Surface& surface, const Limits& limits, Segmentation& segmentation);

/// Refits each region with a nonzero entry in `changed` to the faces with its label, and updates its area and rms.
void refit(const Surface& surface, Segmentation& segmentation, std::span<const char> changed, const RunContext& context);

}  // namespace deform::detection
