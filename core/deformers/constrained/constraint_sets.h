// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/deformers/constrained/constrained_points.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The constraints of a setup on one mesh. They are sorted by content (kind, points, options), so that the result does not depend
/// on their order in the setup.
struct ConstraintSets {
  std::vector<ConstraintSet> sets;         ///< one for each constraint, or with layers for each column of cells
  std::vector<std::size_t> constraint_of;  ///< constraint of each set, as its position in the setup
  std::vector<std::string> notes;
};

/// Builds the sets. `regions` is the result of validate(). Throws the errors of make_projection() and wall_columns(), naming the
/// field of the constraint. Takes one pass over the cells for every constraint with layers, otherwise O(points log points).
ConstraintSets constraint_sets(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const UnitBox& box);

/// Checks each constraint separately as constraint_sets() does and adds the errors to `problems`; constraints that already have
/// one are skipped. Allocates the memory of the largest constraint.
void check_constraint_sets(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const UnitBox& box,
                           Problems& problems);

}  // namespace deform
