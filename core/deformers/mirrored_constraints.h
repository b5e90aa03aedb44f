// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/deformers/mirrored_mesh.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"

namespace deform {

/// The constraints of a half model in the whole one. A shape that continues through a symmetry plane is one shape there: one of
/// its points lies on the plane, and the points with their mirror images fit it as well at rest as the points alone do (twice the
/// misfit, or continuity_tolerance D). So a half bore stays one bore, and the two slopes of a gabled roof remain two planes. All
/// other constraints get a copy for each image, with mirrored planes and axes. Relations between regions always do.
struct MirroredConstraints {
  static constexpr double continuity_tolerance = 1e-6;

  /// `regions` is the result of validate() for the half model. Throws the errors of make_projection(), naming the constraint.
  MirroredConstraints(const Setup& half, const Mesh& mesh, const SelectedRegions& regions, const MirroredMesh& mirrored);

  /// The reports on the constraints of the half model from those of the whole one: of copies the largest distance, and the root
  /// mean square over all of them.
  std::vector<ConstraintReport> reports(std::span<const ConstraintReport> whole) const;

  std::vector<Constraint> constraints;     ///< of the whole model
  std::vector<std::size_t> constraint_of;  ///< of each its constraint of the half model
  std::vector<std::string> notes;          ///< which ones continue through a plane, one sentence each
};

}  // namespace deform
