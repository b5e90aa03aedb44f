// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <map>
#include <vector>

#include "core/mesh/cells.h"
#include "core/mesh/elements.h"

namespace deform::test {

/// Linear elements by their faces: internal ones first, in the order of the elements that close them, then those of the boundary
/// in the order of their corners.
inline PolyhedralCells by_faces(const Elements& elements) {
  PolyhedralCells cells;
  cells.cell_count = elements.size();
  struct Side {
    std::vector<PointId> corners;
    std::uint32_t owner;
  };
  std::map<std::vector<PointId>, Side> open;
  const auto add = [&](const Side& side) {
    cells.face_points.insert(cells.face_points.end(), side.corners.begin(), side.corners.end());
    cells.face_offsets.push_back(cells.face_points.size());
    cells.owner.push_back(side.owner);
  };
  for (std::size_t e = 0; e < elements.size(); ++e) {
    for (const auto& face : shape(elements.types[e]).faces) {
      Side side{{}, static_cast<std::uint32_t>(e)};
      for (const auto node : face) side.corners.push_back(elements.nodes(e)[node]);
      const auto key = face_key(side.corners);
      if (const auto found = open.find(key); found != open.end()) {
        add(found->second);
        cells.neighbour.push_back(side.owner);
        open.erase(found);
      } else {
        open.emplace(key, side);
      }
    }
  }
  for (const auto& [key, side] : open) add(side);
  return cells;
}

}  // namespace deform::test
