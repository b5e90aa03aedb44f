// SPDX-License-Identifier: Apache-2.0
#include "core/quality/face_intersections.h"

#include <algorithm>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/mesh/inspect.h"
#include "core/mesh/polygon_fan.h"
#include "core/mesh/triangle_pairs.h"

namespace deform {

namespace {

constexpr std::size_t candidates_per_range = 1024;  // faces
/// A triangle that intersects more at rest is taken to intersect whatever is near it.
constexpr std::size_t most_partners = 32;

void check_size(std::span<const Vec3> points, std::size_t expected) {
  if (points.size() == expected) return;
  throw Error(ErrorCode::invalid_argument,
              "points: " + std::to_string(points.size()) + ", expected " + std::to_string(expected) + ", those of the mesh");
}

}  // namespace

IntersectionCheck::IntersectionCheck(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context)
    : points_(mesh.point_count()), faces_(mesh.face_count()) {
  check_size(rest, points_);
  starts_.reserve(faces_ + 1);
  std::size_t at = 0;
  for (std::size_t f = 0; f < faces_; at += mesh.face_sizes[f], ++f) {
    starts_.push_back(static_cast<std::uint32_t>(triangles_.size()));
    add_fan(std::span(mesh.face_points).subspan(at, mesh.face_sizes[f]), rest, static_cast<FaceId>(f));
  }
  starts_.push_back(static_cast<std::uint32_t>(triangles_.size()));
  same_ = coincident_points(rest);
  tree_ = TriangleTree(triangles_, rest, context);
  at_rest_ = faces_found(tree_, rest, context, [](std::uint32_t, std::uint32_t) { return true; });
  if (!at_rest_.empty()) remember_rest(rest, context);
}

void IntersectionCheck::add_fan(std::span<const PointId> corners, std::span<const Vec3> rest, FaceId face) {
  const std::size_t size = corners.size();
  if (size < 3) return;
  // Not any corner: of straight quadratic faces, triangles whose area is rounding turn over as soon as an edge bends.
  const std::size_t apex = fan_apex(rest, corners);
  for (std::size_t i = 1; i + 1 < size; ++i) {
    triangles_.push_back({corners[apex], corners[(apex + i) % size], corners[(apex + i + 1) % size]});
    face_of_.push_back(face);
  }
}

void IntersectionCheck::for_each_pair(const TriangleTree& tree, std::span<const Vec3> points, const RunContext& context,
                                      const std::function<bool(std::uint32_t triangle, std::uint32_t other)>& use) const {
  const auto placed = [&](std::uint32_t t) {
    SurfaceTriangle triangle;
    for (std::size_t k = 0; k < 3; ++k) {
      triangle.places[k] = same_[triangles_[t][k]];
      triangle.corners[k] = points[triangles_[t][k]];
    }
    return triangle;
  };
  parallel_for(context, faces_, candidates_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::uint32_t t = starts_[begin]; t < starts_[end]; ++t) {
      const SurfaceTriangle triangle = placed(t);
      if (has_no_area(triangle.corners)) continue;
      Box box;
      for (const Vec3& corner : triangle.corners) box.add(corner);
      tree.meeting(box, [&](std::uint32_t other) {
        if (face_of_[other] == face_of_[t]) return true;
        const SurfaceTriangle met = placed(other);
        return !intersect(triangle, met) || has_no_area(met.corners) || use(t, other);
      });
    }
  });
}

std::vector<IntersectingFace> IntersectionCheck::faces_found(
    const TriangleTree& tree, std::span<const Vec3> points, const RunContext& context,
    const std::function<bool(std::uint32_t, std::uint32_t)>& counts) const {
  constexpr FaceId none = ~FaceId{0};
  std::vector<FaceId> others(faces_, none);
  for_each_pair(tree, points, context, [&](std::uint32_t triangle, std::uint32_t other) {
    FaceId& found = others[face_of_[triangle]];
    if (found == none && counts(triangle, other)) found = face_of_[other];
    return found == none;
  });
  std::vector<IntersectingFace> faces;
  for (std::size_t f = 0; f < faces_; ++f) {
    if (others[f] != none) faces.push_back({static_cast<FaceId>(f), others[f]});
  }
  return faces;
}

void IntersectionCheck::remember_rest(std::span<const Vec3> rest, const RunContext& context) {
  std::vector<std::vector<std::uint32_t>> partners(triangles_.size());
  for_each_pair(tree_, rest, context, [&](std::uint32_t triangle, std::uint32_t other) {
    partners[triangle].push_back(other);
    return partners[triangle].size() <= most_partners;
  });
  partners_.starts.push_back(0);
  for (const auto& list : partners) {
    partners_.items.insert(partners_.items.end(), list.begin(), list.end());
    partners_.starts.push_back(partners_.items.size());
  }
  uses_.starts.assign(points_ + 1, 0);
  for (const Triangle& triangle : triangles_) {
    for (const PointId corner : triangle) ++uses_.starts[same_[corner] + 1];
  }
  for (std::size_t i = 0; i < points_; ++i) uses_.starts[i + 1] += uses_.starts[i];
  uses_.items.resize(3 * triangles_.size());
  std::vector<std::uint64_t> next(uses_.starts.begin(), uses_.starts.end() - 1);
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    for (const PointId corner : triangles_[t]) uses_.items[next[same_[corner]]++] = static_cast<std::uint32_t>(t);
  }
}

// Whether a triangle at one of the places of `triangle` intersected one at the places of `other`, or the other way round.
bool IntersectionCheck::intersected_nearby(std::uint32_t triangle, std::uint32_t other) const {
  const auto share_place = [&](std::uint32_t s, std::uint32_t t) {
    for (const PointId a : triangles_[s]) {
      for (const PointId b : triangles_[t]) {
        if (same_[a] == same_[b]) return true;
      }
    }
    return false;
  };
  for (const auto& [from, to] : {std::pair(triangle, other), std::pair(other, triangle)}) {
    for (const PointId corner : triangles_[from]) {
      for (const std::uint32_t near : uses_.of(same_[corner])) {
        const auto partners = partners_.of(near);
        if (partners.size() > most_partners) return true;
        for (const std::uint32_t partner : partners) {
          if (share_place(partner, to)) return true;
        }
      }
    }
  }
  return false;
}

TriangleTree IntersectionCheck::moved(std::span<const Vec3> points, const RunContext& context) const {
  check_size(points, points_);
  return tree_.moved(points, context);
}

std::vector<IntersectingFace> IntersectionCheck::at(std::span<const Vec3> points, const RunContext& context) const {
  return faces_found(moved(points, context), points, context, [](std::uint32_t, std::uint32_t) { return true; });
}

std::vector<IntersectingFace> IntersectionCheck::appeared(std::span<const Vec3> points, const RunContext& context) const {
  return faces_found(moved(points, context), points, context, [this](std::uint32_t triangle, std::uint32_t other) {
    return at_rest_.empty() || !intersected_nearby(triangle, other);
  });
}

std::size_t IntersectionCheck::bytes() const {
  const auto of = [](const Lists& lists) {
    return lists.starts.size() * sizeof(std::uint64_t) + lists.items.size() * sizeof(std::uint32_t);
  };
  return TriangleTree::bytes_for(triangles_.size()) + triangles_.size() * (sizeof(Triangle) + sizeof(FaceId)) +
         starts_.size() * sizeof(std::uint32_t) + at_rest_.size() * sizeof(IntersectingFace) + of(partners_) + of(uses_) +
         same_.size() * sizeof(PointId);
}

std::size_t IntersectionCheck::bytes_for(const Mesh& mesh) {
  const std::size_t triangles = mesh.face_points.size(), faces = mesh.face_count();
  // Partners twice: as they are found, and in one list.
  constexpr std::size_t per_triangle = sizeof(Triangle) + sizeof(FaceId) + sizeof(std::vector<std::uint32_t>) +
                                       sizeof(std::uint64_t) + 3 * (most_partners + 1) * sizeof(std::uint32_t) +
                                       3 * sizeof(std::uint32_t);
  constexpr std::size_t per_face = sizeof(std::uint32_t) + sizeof(FaceId) + sizeof(IntersectingFace);
  constexpr std::size_t per_point = 2 * sizeof(PointId) + 2 * sizeof(std::uint64_t);
  return TriangleTree::bytes_for(triangles) + triangles * per_triangle + (faces + 1) * per_face +
         (mesh.point_count() + 1) * per_point;
}

std::size_t IntersectionCheck::call_bytes() const {
  return TriangleTree::bytes_for(triangles_.size()) + faces_ * (sizeof(FaceId) + sizeof(IntersectingFace));
}

std::vector<IntersectingFace> intersecting_faces(const Mesh& mesh, const RunContext& context) {
  return IntersectionCheck(mesh, mesh.points, context).at_rest();
}

}  // namespace deform
