// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/handles/constraint_points.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The constraint points that become centres of an RBF, and what was decided about the others (thesis 3.5, figure 3.10).
struct RbfCentres {
  std::vector<PointId> ids;  ///< ascending; one representative (the smallest id) per place
  std::size_t merged = 0;    ///< centres saved by merging
  bool reduced = false;
  /// More than there are: those that the motions of the handles are missed at most by are to be added, until the tolerance of the
  /// options is met or there are so many. Else as many as there are.
  std::size_t most = 0;
  std::vector<std::string> notes;
};

/// That of the options or its default.
inline double reduction_tolerance(const RbfOptions& options) {
  return options.reduction_tolerance != 0 ? options.reduction_tolerance : default_reduction_tolerance(*options.kernel);
}

/// By the rule of the options. CentreReduction::tolerance gives what depends on places alone: constraint points that share a face
/// with a deformable point, and of the others as many as have a distance of half (where that makes too many, up to 0.8 of) their
/// distance from the nearest deformable point from each other. So the density depends on where points are, not on how the mesh
/// connects them, and what is near to deformable points, as in layers of cells on a wall, is kept.
RbfCentres choose_centres(const Mesh& mesh, const ConstraintPoints& points, std::size_t handles, const RbfOptions& options,
                          const RunContext& context = {});

/// Points whose misfits are measured at once.
inline constexpr std::size_t points_looked_at = 65536;

/// As many as there may be: any ones, for upper bounds.
void take_most(const ConstraintPoints& points, RbfCentres& centres);

/// Of some constraint points, with the motions' misfits there, those that are to become centres: where the misfit is largest and
/// over half of the tolerance, at distances from each other that are like those from the centres, at most `most`. Ascending.
std::vector<PointId> most_missed(const Mesh& mesh, const std::vector<PointId>& centres, std::span<const PointId> ids,
                                 std::span<const double> misfits, double tolerance, std::size_t most);

}  // namespace deform
