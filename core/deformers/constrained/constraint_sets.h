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

/// What the constraints of a setup are about on one mesh: sorted by what they say (kind, points, options), not as they are
/// written.
struct ConstraintSets {
  std::vector<ConstraintSet> sets;         ///< one per constraint, but of layers one per column of cells
  std::vector<std::size_t> constraint_of;  ///< per set
  std::vector<std::string> notes;
};

/// Regions as validate() gives them. Throws what make_projection() and wall_columns() throw, naming the constraint's field. One
/// pass over the cells for every constraint with layers, else O(points log points).
ConstraintSets constraint_sets(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const UnitBox& box);

/// Whether constraint_sets() takes the constraints, each for itself; those that `problems` has already are left out. Allocates
/// what the largest of them takes.
void check_constraint_sets(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const UnitBox& box,
                           Problems& problems);

}  // namespace deform
