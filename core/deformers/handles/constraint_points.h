// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The points of handles and fixed regions of a mesh (constraint points), and the others.
struct ConstraintPoints {
  std::vector<RegionIndex> region_of;  ///< n
  std::vector<PointId> deformable;     ///< ascending
  /// Constraint points that coincide (within 1e-12 D), ascending, at least two each.
  std::vector<std::vector<PointId>> coincident;
  std::size_t count = 0;  ///< number of constraint points
};

/// Throws the errors of RunContext::check().
ConstraintPoints constraint_points(const Mesh& mesh, const SelectedRegions& regions, const RunContext& context = {});

/// Mask of the constraint points of n that are in a face, or a face of a polyhedral cell, or an element with a deformable one;
/// all constraint points of a mesh without faces and cells.
std::vector<char> next_to_deformable(const Mesh& mesh, const std::vector<RegionIndex>& region_of);

}  // namespace deform
