// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/adjacency.h"

#include <algorithm>
#include <numeric>

#include "core/base/error.h"
#include "core/mesh/edge_uses.h"

namespace deform {

namespace {

bool repeats_a_corner(std::span<const PointId> corners, std::vector<PointId>& scratch) {
  if (corners.size() == 3) return corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0];
  scratch.assign(corners.begin(), corners.end());
  std::sort(scratch.begin(), scratch.end());
  return std::adjacent_find(scratch.begin(), scratch.end()) != scratch.end();
}

/// Counts the fans of faces at a point: faces are in one fan when they share an edge that ends there.
class FanCounter {
 public:
  std::size_t count(const Adjacency& adjacency, PointId point) {
    const auto faces = adjacency.faces_of(point);
    parent_.resize(faces.size());
    std::iota(parent_.begin(), parent_.end(), 0U);
    ends_.clear();
    for (std::uint32_t local = 0; local < faces.size(); ++local) {
      const auto corners = adjacency.points_of(faces[local]);
      for (std::size_t i = 0; i < corners.size(); ++i) {
        if (corners[i] != point) continue;
        ends_.push_back({corners[i + 1 == corners.size() ? 0 : i + 1], local});
        ends_.push_back({corners[i == 0 ? corners.size() - 1 : i - 1], local});
      }
    }
    std::sort(ends_.begin(), ends_.end());
    std::size_t fans = faces.size();
    for (std::size_t i = 1; i < ends_.size(); ++i) {
      if (ends_[i].first != ends_[i - 1].first) continue;
      const std::uint32_t a = root(ends_[i].second), b = root(ends_[i - 1].second);
      if (a == b) continue;
      parent_[a] = b;
      --fans;
    }
    return fans;
  }

 private:
  std::uint32_t root(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }

  std::vector<std::uint32_t> parent_;
  std::vector<std::pair<PointId, std::uint32_t>> ends_;
};

}  // namespace

Adjacency::Adjacency(const Mesh& mesh) : mesh_(mesh), face_offsets_(mesh.face_offsets()) {
  const std::size_t n = mesh.point_count();
  const auto faces = static_cast<FaceId>(mesh.face_count());
  // Counted and filled in face order; a corner repeated within its face is seen because the face was the last one entered.
  constexpr FaceId none = ~FaceId{0};
  std::vector<FaceId> last(n, none);
  point_offsets_.assign(n + 1, 0);
  for (FaceId face = 0; face < faces; ++face) {
    for (const PointId point : points_of(face)) {
      if (last[point] == face) continue;
      last[point] = face;
      ++point_offsets_[point + 1];
    }
  }
  std::partial_sum(point_offsets_.begin(), point_offsets_.end(), point_offsets_.begin());
  point_faces_.resize(point_offsets_[n]);
  std::fill(last.begin(), last.end(), none);
  std::vector<std::uint64_t> next(point_offsets_.begin(), point_offsets_.end() - 1);
  for (FaceId face = 0; face < faces; ++face) {
    for (const PointId point : points_of(face)) {
      if (last[point] == face) continue;
      last[point] = face;
      point_faces_[next[point]++] = face;
    }
  }
}

std::span<const FaceId> Adjacency::faces_of(PointId point) const {
  return {point_faces_.data() + point_offsets_[point], point_faces_.data() + point_offsets_[point + 1]};
}

std::span<const PointId> Adjacency::points_of(FaceId face) const {
  return {mesh_.face_points.data() + face_offsets_[face], mesh_.face_points.data() + face_offsets_[face + 1]};
}

std::vector<char> Adjacency::grow(const std::vector<char>& seed, int rings) const {
  if (seed.size() != mesh_.point_count()) {
    throw Error(ErrorCode::invalid_argument, "grow: the seed mask has " + std::to_string(seed.size()) +
                                                 " entries, the mesh has " + std::to_string(mesh_.point_count()) + " points");
  }
  std::vector<char> mask = seed;
  std::vector<char> face_done(mesh_.face_count(), 0);
  std::vector<PointId> front, next;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask[i]) front.push_back(static_cast<PointId>(i));
  }
  for (int ring = 0; (rings < 0 || ring < rings) && !front.empty(); ++ring) {
    next.clear();
    for (const PointId point : front) {
      for (const FaceId face : faces_of(point)) {
        if (face_done[face]) continue;
        face_done[face] = 1;
        for (const PointId corner : points_of(face)) {
          if (mask[corner]) continue;
          mask[corner] = 1;
          next.push_back(corner);
        }
      }
    }
    front.swap(next);
  }
  return mask;
}

std::vector<char> Adjacency::boundary_points() const {
  std::vector<char> mask(mesh_.point_count(), 0);
  std::vector<EdgeUse> edges;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    edge_uses(*this, static_cast<PointId>(i), edges);
    mask[i] = std::any_of(edges.begin(), edges.end(), [](const EdgeUse& e) { return e.faces() == 1; });
  }
  return mask;
}

std::vector<char> Adjacency::non_manifold_points() const {
  std::vector<char> mask(mesh_.point_count(), 0);
  std::vector<PointId> scratch;
  for (std::size_t face = 0; face < mesh_.face_count(); ++face) {
    const auto corners = points_of(static_cast<FaceId>(face));
    if (corners.size() >= 3 && !repeats_a_corner(corners, scratch)) continue;
    for (const PointId point : corners) mask[point] = 1;
  }
  std::vector<EdgeUse> edges;
  FanCounter fans;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask[i]) continue;
    const auto point = static_cast<PointId>(i);
    edge_uses(*this, point, edges);
    mask[i] = std::any_of(edges.begin(), edges.end(), [](const EdgeUse& e) { return e.outgoing > 1 || e.incoming > 1; }) ||
              fans.count(*this, point) != 1;
  }
  return mask;
}

}  // namespace deform
