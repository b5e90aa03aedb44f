// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/deformers/handles/constraint_points.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The constraint points that become centres of an RBF, and what was decided about the others (thesis 3.5, figure 3.10).
struct RbfCentres {
  std::vector<PointId> ids;  ///< ascending; one representative (the smallest id) per place
  std::size_t merged = 0;    ///< centres saved by merging
  bool reduced = false;
  std::vector<std::string> notes;
};

RbfCentres choose_centres(const Mesh& mesh, const ConstraintPoints& points, std::size_t handles, const RbfOptions& options);

}  // namespace deform
