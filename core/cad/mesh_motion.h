// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/base/types.h"

namespace deform::cad {

/// The mesh of a CAD model as a design moves it, in the unit of the mesh.
struct MeshMotion {
  Points rest, moved;             ///< n x 3 each
  std::vector<PointId> boundary;  ///< nodes that lie on the model, ascending
  /// Points that a constraint keeps on a shape, and how far the farthest is from it.
  struct Kept {
    std::vector<PointId> points;  ///< ascending
    double largest = 0;
  };
  std::vector<Kept> kept;
};

}  // namespace deform::cad
