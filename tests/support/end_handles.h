// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <vector>

#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform::test {

/// The handles "first" and "last": 15 % of the mesh at each end of its longest side.
inline std::vector<Handle> end_handles(const Mesh& mesh) {
  const Box box = bounding_box(mesh.points);
  std::size_t axis = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (box.side(k) > box.side(axis)) axis = k;
  }
  const double far = 1e9;
  Region::InBox first{{-far, -far, -far}, {far, far, far}}, last = first;
  first.max[axis] = box.min[axis] + 0.15 * box.side(axis);
  last.min[axis] = box.max[axis] - 0.15 * box.side(axis);
  return {{"first", Region{first}}, {"last", Region{last}}};
}

}  // namespace deform::test
