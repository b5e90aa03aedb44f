// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/symmetry_sides.h"

#include <utility>
#include <vector>

#include "core/deformers/handles/symmetry.h"

namespace deform {

PlaneSides symmetry_sides(const Setup& setup, const Mesh& mesh) {
  if (setup.symmetry.empty()) return {};
  const Symmetry symmetry(setup.symmetry, mesh);
  const double tolerance = Symmetry::tolerance * bounding_box(mesh.points).diagonal();
  std::vector<PlaneSides::Side> sides;
  for (std::size_t k = 0; k < symmetry.planes(); ++k) {
    sides.push_back({symmetry.normal(k), symmetry.coordinates({})[k], symmetry.reach(k) + tolerance});
  }
  return PlaneSides(std::move(sides));
}

}  // namespace deform
