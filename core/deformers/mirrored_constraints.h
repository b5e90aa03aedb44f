// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/constraints/constraint.h"
#include "core/constraints/projection.h"
#include "core/deformers/mirrored_mesh.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"

namespace deform {

/// The constraints of a half model in the whole one. A shape that continues through a symmetry plane is one shape there: one of
/// its points lies on the plane, and the points with their mirror images fit it at rest about as well as the points alone do
/// (five times the misfit, which allows for a smooth curvature across the plane, or continuity_tolerance D). So a half bore stays
/// one bore, and the two slopes of a gabled roof remain two planes. All other constraints get a copy for each image, with
/// mirrored planes and axes. Relations between regions always do. Weights stay, so that the result is that of the whole model
/// with the same weights.
struct MirroredConstraints {
  static constexpr double continuity_tolerance = 1e-6;

  /// `regions` is the result of validate() for the half model; `mirrored` must outlive this object. Throws the errors of
  /// make_projection(), naming the constraint.
  MirroredConstraints(const Setup& half, const Mesh& mesh, const SelectedRegions& regions, const MirroredMesh& mirrored);

  /// The reports on the constraints of the half model from those of the whole one: of copies the largest distance, and the root
  /// mean square over all of them. As delivered are the points of the half model, `place_of` each id, and their mirror images,
  /// which the whole model has nearly so if its functions are not symmetric: they are measured here, but for columns of cells.
  std::vector<ConstraintReport> reports(std::span<const ConstraintReport> whole,
                                        const std::function<Vec3(PointId)>& place_of) const;

  std::vector<Constraint> constraints;     ///< of the whole model
  std::vector<std::size_t> constraint_of;  ///< of each its constraint of the half model
  std::vector<std::string> notes;          ///< which ones continue through a plane, one sentence each

 private:
  /// A constraint of the half model with those images that are joined with it.
  struct Set {
    struct Place {
      PointId id;
      std::size_t image;
    };
    std::vector<Place> places;
    std::unique_ptr<const Projection> projection;  ///< null for columns of cells
    bool exact = false;
    std::vector<ConstraintReport::Held> held;  ///< points of the half model
  };
  void add_set(const Constraint& constraint, const std::vector<std::vector<PointId>>& regions, const Symmetry& symmetry,
               std::size_t planes, bool columns);

  const MirroredMesh* mirrored_;
  UnitMap units_;
  std::vector<Set> sets_;  ///< for each constraint of the half model
};

}  // namespace deform
