#pragma once

#include <string>
#include <vector>

#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The constraint points that become centres of an RBF, and what was decided about the others (thesis 3.5, figure 3.10).
struct RbfCentres {
  std::vector<RegionIndex> region_of;  ///< n
  std::vector<PointId> deformable;     ///< ascending
  std::vector<PointId> ids;            ///< ascending; one representative (the smallest id) per place
  /// Constraint points that coincide (within 1e-12 D), the representative first, at least two each: a design must send them to
  /// one place.
  std::vector<std::vector<PointId>> coincident;
  std::size_t constraint_points = 0;
  std::size_t merged = 0;  ///< centres saved by merging
  bool reduced = false;
  std::vector<std::string> notes;
};

RbfCentres choose_centres(const Mesh& mesh, const SelectedRegions& regions, const RbfOptions& options);

}  // namespace deform
