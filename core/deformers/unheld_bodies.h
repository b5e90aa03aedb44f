// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// A part of a mesh, connected by its faces and cells, that has no point in a handle or fixed region.
struct UnheldBody {
  std::size_t points = 0;
  PointId first = 0;  ///< its first point
  Vec3 centre{};      ///< mean of its points, model units
};

/// The bodies that nothing holds, in the order of their first points. Parts that only share places, as at seams, count as
/// connected. With several methods a body is held if any of them holds it. None for control points, and for meshes without faces
/// and cells. Memory: about 8 bytes per point, with seams 12.
std::vector<UnheldBody> unheld_bodies(const Mesh& mesh, const SelectedRegions& regions);

/// The same as a note of one sentence for the setup; empty if there are none.
std::string unheld_bodies_note(const Mesh& mesh, const SelectedRegions& regions);

}  // namespace deform
