// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/detection/clusters.h"

#include <algorithm>
#include <cmath>

namespace deform::detection {

namespace {

constexpr FaceId nowhere = 0xffffffff;

}  // namespace

Clusters::Clusters(const Surface& fine, double largest) {
  gather(fine, largest);
  connect(fine);
}

std::vector<std::uint32_t> Clusters::labels(std::span<const std::uint32_t> of_faces) const {
  std::vector<std::uint32_t> result(count());
  for (std::size_t c = 0; c < result.size(); ++c) result[c] = of_faces[order[begin[c]]];
  return result;
}

void Clusters::gather(const Surface& fine, double largest) {
  const double bend = fine.maximum_angle / 4;
  order.reserve(fine.face_count());
  cluster_of.assign(fine.face_count(), nowhere);
  // The next one starts beside the last ones, so that few slivers remain between them.
  std::vector<FaceId> rim;
  const auto add_cluster = [&](FaceId seed) {
    const auto c = static_cast<FaceId>(begin.size());
    begin.push_back(order.size());
    order.push_back(seed);
    cluster_of[seed] = c;
    double area = fine.area[seed];
    const auto belongs = [&](FaceId f) {
      if (area + fine.area[f] > largest) return false;
      if (fine.area[f] == 0) return true;
      const double angle = bend + fine.allowance(seed) + fine.allowance(f);
      return angle >= 1.5 || std::abs(fine.normal[f].dot(fine.normal[seed])) >= std::cos(angle);
    };
    for (std::size_t i = begin.back(); i < order.size(); ++i) {
      for (const FaceId f : fine.passages(order[i])) {
        if (cluster_of[f] != nowhere) continue;
        if (!belongs(f)) {
          rim.push_back(f);
          continue;
        }
        cluster_of[f] = c;
        order.push_back(f);
        area += fine.area[f];
      }
    }
  };
  for (const bool without_area : {false, true}) {
    for (std::size_t start = 0; start < fine.face_count(); ++start) {
      if (cluster_of[start] != nowhere || (fine.area[start] == 0) != without_area) continue;
      rim.assign(1, static_cast<FaceId>(start));
      for (std::size_t i = 0; i < rim.size(); ++i) {
        if (cluster_of[rim[i]] == nowhere && (fine.area[rim[i]] == 0) == without_area) add_cluster(rim[i]);
      }
    }
  }
  begin.push_back(order.size());
}

void Clusters::connect(const Surface& fine) {
  const std::size_t clusters = count();
  surface.middle = fine.middle;
  surface.size = fine.size;
  surface.model_area = fine.model_area;
  surface.total_area = fine.total_area;
  surface.noise = fine.noise;
  surface.maximum_angle = fine.maximum_angle;
  surface.points = fine.points;
  surface.offsets.assign(1, 0);
  surface.first.assign(1, 0);
  std::vector<std::size_t> place(clusters, 0);  // of the last entry for that neighbour, plus 1
  for (std::size_t c = 0; c < clusters; ++c) {
    const FaceId f = order[begin[c]];
    const auto corners = fine.corners(f);
    surface.joined_corners.insert(surface.joined_corners.end(), corners.begin(), corners.end());
    surface.offsets.push_back(surface.joined_corners.size());
    surface.normal.push_back(fine.normal[f]);
    surface.centre.push_back(fine.centre[f]);
    surface.height.push_back(fine.height[f]);
    surface.least_cosine.push_back(fine.least_cosine[f]);
    surface.level.push_back(fine.level[f]);
    double area = 0;
    for (const FaceId member : faces(c)) {
      area += fine.area[member];
      for (const Neighbour& n : fine.neighbours(member)) {
        const FaceId other = cluster_of[n.face];
        if (other == c || !fine.passable(member, n)) continue;
        if (place[other] > surface.first.back()) {
          double& angle = surface.adjacent[place[other] - 1].angle;
          angle = std::min(angle, n.angle);
        } else {
          surface.adjacent.push_back({other, 0, 0, false, n.angle});
          place[other] = surface.adjacent.size();
        }
      }
    }
    surface.area.push_back(area);
    surface.first.push_back(surface.adjacent.size());
  }
  surface.first_passage = surface.first;
  for (const Neighbour& n : surface.adjacent) surface.passage.push_back(n.face);
}

}  // namespace deform::detection
