// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/edge_uses.h"

#include <algorithm>

namespace deform {

void edge_uses(const Adjacency& adjacency, PointId point, std::vector<EdgeUse>& edges) {
  edges.clear();
  for (const FaceId face : adjacency.faces_of(point)) {
    const auto corners = adjacency.points_of(face);
    if (corners.size() < 3) continue;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      if (corners[i] != point) continue;
      const PointId next = corners[i + 1 == corners.size() ? 0 : i + 1];
      const PointId previous = corners[i == 0 ? corners.size() - 1 : i - 1];
      if (next != point) edges.push_back({next, 1, 0});
      if (previous != point) edges.push_back({previous, 0, 1});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const EdgeUse& a, const EdgeUse& b) { return a.other < b.other; });
  std::size_t kept = 0;
  for (std::size_t i = 0; i < edges.size(); ++i) {
    if (kept > 0 && edges[kept - 1].other == edges[i].other) {
      edges[kept - 1].outgoing += edges[i].outgoing;
      edges[kept - 1].incoming += edges[i].incoming;
    } else {
      edges[kept++] = edges[i];
    }
  }
  edges.resize(kept);
}

}  // namespace deform
