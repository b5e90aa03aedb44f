// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/base/run_context.h"
#include "core/constraints/detection/growth.h"

namespace deform::detection {

/// Regions and for each face the index of its region or unlabelled.
struct Segmentation {
  std::vector<Region> regions;
  std::vector<std::uint32_t> labels;
};

/// Gives every face at the rim of a region to the neighbour that describes it best in distance and direction, refitting, until
/// nothing changes or a few sweeps are done; then takes away pieces that came off and regions that became too small.
void compete(const Surface& surface, const Limits& limits, Segmentation& segmentation, const RunContext& context);

/// Takes away what ran on tangentially at the rims of the regions: faces that are off both in distance and in direction by more
/// than the others in their region.
void trim(const Surface& surface, const Limits& limits, Segmentation& segmentation, const RunContext& context);

/// Takes away curved regions that are not evident() now that they are whole.
void drop_accidental(const Surface& surface, Segmentation& segmentation);

/// Joins regions of one surface (see Primitive).
void join_regions(const Surface& surface, const Limits& limits, Segmentation& segmentation);

/// Region r refitted to the faces with its label, with area and rms.
void refit(const Surface& surface, Segmentation& segmentation, std::span<const char> changed, const RunContext& context);

}  // namespace deform::detection
